// Tangled from chapters/encodings.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the bytes of a file to its text.

use std::borrow::Cow;
use std::io::{self, Read};

use flate2::bufread::GzDecoder;
use ruzstd::decoding::StreamingDecoder;

use crate::error::{Diagnostic, Result};

/// The text of a file: decompressed if it begins like gzip or zstd, and in
/// UTF-8 if it begins with a mark of UTF-16. A warning reports bytes that
/// were left out.
///
/// # Errors
/// Compressed files that are damaged or cut short, those of other formats,
/// and UTF-16 that ends within a character.
pub fn text<'a>(
    source: &'a [u8],
    warnings: &mut Vec<Diagnostic>,
) -> Result<Cow<'a, [u8]>> {
    let mut bytes = Cow::Borrowed(source);
    for _ in 0..2 {
        if let Some(kind @ ("gzip" | "zstd")) = format(&bytes) {
            bytes = unpack(kind, &bytes, warnings)?.into();
        }
    }
    match format(&bytes) {
        None => Ok(bytes),
        Some("UTF-16") => Ok(utf_8(&bytes)?.into()),
        Some(kind) => {
            Err(format!("the format is {kind}: unpack it first").into())
        }
    }
}

/// The format of bytes that are no plain text, from their beginning.
pub fn format(bytes: &[u8]) -> Option<&'static str> {
    Some(match bytes {
        [0xff, 0xfe, ..] | [0xfe, 0xff, ..] => "UTF-16",
        [0x1f, 0x8b, ..] => "gzip",
        [0x28, 0xb5, 0x2f, 0xfd, ..] => "zstd",
        [0x50..=0x5f, 0x2a, 0x4d, 0x18, ..] => "zstd",
        [b'P', b'K', 3 | 5 | 7, ..] => "zip",
        [0xfd, b'7', b'z', b'X', b'Z', ..] => "xz",
        [b'B', b'Z', b'h', b'1'..=b'9', ..] => "bzip2",
        [0x04, 0x22, 0x4d, 0x18, ..] => "lz4",
        [b'7', b'z', 0xbc, 0xaf, ..] => "7z",
        _ if bytes.get(257..262) == Some(b"ustar") => "tar",
        _ => return None,
    })
}

/// The format of a model that is no Wavefront OBJ, from its beginning.
pub fn foreign(bytes: &[u8]) -> Option<&'static str> {
    let begins = [
        ("PLY", "ply"),
        ("STL", "solid"),
        ("glTF", "glTF"),
        ("glTF or other JSON", "{"),
        ("COLLADA or other XML", "<"),
        ("FBX", "Kaydara FBX"),
        ("FBX", "; FBX"),
        ("Blender", "BLENDER"),
        ("USD", "#usda"),
        ("USD", "PXR-USDC"),
        ("VRML", "#VRML"),
        ("OFF", "OFF"),
    ];
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let text = text.trim_ascii_start();
    let begun = |(_, start): &&(_, &str)| {
        let head = text.get(..start.len());
        head.is_some_and(|head| head.eq_ignore_ascii_case(start.as_bytes()))
    };
    let named = begins.iter().find(begun).map(|(name, _)| *name);
    let count = bytes.get(80..).and_then(|rest| rest.first_chunk());
    let faces = count.map_or(0, |count| u32::from_le_bytes(*count));
    let is_stl = faces > 0 && (bytes.len() - 84) / 50 == faces as usize;
    named.or(is_stl.then_some("STL"))
}

/// Appends the next frame of zstd to a text, and moves behind it.
fn unzstd(rest: &mut &[u8], text: &mut Vec<u8>) -> io::Result<usize> {
    if let [0x50..=0x5f, 0x2a, 0x4d, 0x18, a, b, c, d, next @ ..] = *rest {
        let length = u32::from_le_bytes([*a, *b, *c, *d]) as usize;
        *rest = next.get(length..).ok_or(io::ErrorKind::UnexpectedEof)?;
        return Ok(0);
    }
    let frame = StreamingDecoder::new(&mut *rest);
    let mut frame = frame.map_err(io::Error::other)?;
    let size = frame.read_to_end(text)?;
    let frame = frame.into_frame_decoder();
    let found = frame.get_checksum_from_data();
    match found.is_some() && found != frame.get_calculated_checksum() {
        true => Err(io::Error::other("the checksum is another")),
        false => Ok(size),
    }
}

/// The content of a file of this kind.
fn unpack(
    kind: &str,
    source: &[u8],
    warnings: &mut Vec<Diagnostic>,
) -> Result<Vec<u8>> {
    let (mut out, mut rest) = (Vec::new(), source);
    for part in 1.. {
        let zeros = rest.iter().take_while(|byte| **byte == 0);
        rest = &rest[zeros.count()..];
        let begin = source.len() - rest.len();
        let unpacked = match format(rest) {
            _ if rest.is_empty() => break,
            Some("gzip") => GzDecoder::new(&mut rest).read_to_end(&mut out),
            Some("zstd") => unzstd(&mut rest, &mut out),
            _ if kind == "zstd" => Err(io::Error::other("no frame")),
            _ => {
                let what =
                    format!("no gzip from byte {begin} on: left out");
                warnings.push(what.into());
                break;
            }
        };
        let at = source.len() - rest.len();
        let place = format!("at byte {at} in part {part}, from {begin} on");
        let faulty = |e| format!("the {kind} file {} {place}", fault(&e));
        unpacked.map_err(faulty)?;
    }
    Ok(out)
}

fn fault(error: &io::Error) -> &'static str {
    let names = format!("{error:?}");
    let faults = [
        ("UnexpectedEof", "is cut short"),
        ("checksum", "is damaged (its checksum is another)"),
        ("DictNotProvided", "is packed with a dictionary"),
        ("WindowSizeTooBig", "has a window of more than 128 MiB"),
        ("OutOfMemory", "is too large for the memory"),
    ];
    let found = faults.iter().find(|(name, _)| names.contains(name));
    found.map_or("is damaged", |(_, what)| what)
}

/// The text of pairs of bytes in UTF-16.
fn utf_8(bytes: &[u8]) -> Result<Vec<u8>> {
    let (pairs, []) = bytes.as_chunks::<2>() else {
        return Err("the UTF-16 text ends within a letter".into());
    };
    let is_big = bytes.starts_with(&[0xfe]);
    let unit = if is_big { u16::from_be_bytes } else { u16::from_le_bytes };
    let units: Vec<u16> = pairs.iter().map(|&pair| unit(pair)).collect();
    Ok(String::from_utf16_lossy(&units).into_bytes())
}

/// A line, as messages quote it.
pub fn quoted(line: &str) -> String {
    let visible = |c: char| match c {
        '"' | '\'' | '\\' => c.to_string(),
        _ => c.escape_debug().to_string(),
    };
    let shown: String = line.trim().chars().map(visible).collect();
    match shown.char_indices().nth(77) {
        Some((end, _)) => format!("{}...", &shown[..end]),
        None => shown,
    }
}

/// A message with each of its words quoted like a line.
pub(crate) fn shortened(message: &str) -> String {
    let words = message.split(' ').map(quoted);
    words.collect::<Vec<_>>().join(" ")
}
