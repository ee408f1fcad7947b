// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! From the bytes of a file to a text whose lines end in newlines.

use std::borrow::Cow;
use std::error::Error;
use std::io::{self, Read};
use std::iter::successors;

use flate2::read::MultiGzDecoder;
use memchr::memchr;
use ruzstd::decoding::StreamingDecoder;

// Turn the bytes into a text
/// The text of a file, decompressed if it begins as gzip or zstd do, in
/// UTF-8 if it begins with a mark of UTF-16, and with newlines.
///
/// # Errors
/// Compressed files that are damaged or cut short, and UTF-16 that ends
/// within a character.
pub fn text(source: &[u8]) -> Result<Cow<'_, [u8]>, String> {
    let bytes = match source {
        [0x1f, 0x8b, ..] => Cow::Owned(unpack("gzip", gunzip, source)?),
        [0x28, 0xb5, 0x2f, 0xfd, ..] => {
            Cow::Owned(unpack("zstd", unzstd, source)?)
        }
        _ => Cow::Borrowed(source),
    };
    // Take two bytes for a character after a mark
    let mut text = match &*bytes {
        [0xff, 0xfe, rest @ ..] => utf_8(rest, u16::from_le_bytes)?.into(),
        [0xfe, 0xff, rest @ ..] => utf_8(rest, u16::from_be_bytes)?.into(),
        _ => bytes,
    };
    // Let lines end in newlines
    let has = |byte| memchr(byte, &text).is_some();
    if !has(b'\n') && has(b'\r') {
        let returns = text.to_mut().iter_mut().filter(|c| **c == b'\r');
        returns.for_each(|byte| *byte = b'\n');
    }
    Ok(text)
}

// Unpack a compressed file
fn gunzip(source: &[u8], text: &mut Vec<u8>) -> io::Result<()> {
    MultiGzDecoder::new(source).read_to_end(text).map(|_| ())
}

fn unzstd(mut source: &[u8], text: &mut Vec<u8>) -> io::Result<()> {
    while !source.is_empty() {
        let frame = StreamingDecoder::new(&mut source);
        let mut frame = frame.map_err(io::Error::other)?;
        frame.read_to_end(text)?;
        let frame = frame.into_frame_decoder();
        let found = frame.get_checksum_from_data();
        if found.is_some() && found != frame.get_calculated_checksum() {
            return Err(io::Error::other("the checksum is another"));
        }
    }
    Ok(())
}

/// Whether bytes begin as one of the encodings does.
pub fn is_encoded(start: &[u8]) -> bool {
    let marks: [&[u8]; 4] =
        [b"\x1f\x8b", b"\x28\xb5\x2f\xfd", b"\xff\xfe", b"\xfe\xff"];
    marks.iter().any(|mark| start.starts_with(mark))
}

/// What a function unpacks, or why it cannot.
fn unpack(
    kind: &str,
    function: fn(&[u8], &mut Vec<u8>) -> io::Result<()>,
    source: &[u8],
) -> Result<Vec<u8>, String> {
    let mut text = Vec::new();
    match function(source, &mut text) {
        Ok(()) => Ok(text),
        Err(e) if is_cut(&e) => {
            Err(format!("the {kind} file is cut short"))
        }
        Err(e) => Err(format!("the {kind} file is damaged: {e}")),
    }
}

// Tell what is wrong with it
/// Whether a decoder wanted more bytes than there were.
fn is_cut(error: &io::Error) -> bool {
    let first: &(dyn Error + 'static) = error;
    let mut chain = successors(Some(first), |&error| error.source());
    let is_end = |e: &io::Error| e.kind() == io::ErrorKind::UnexpectedEof;
    chain.any(|e| e.downcast_ref::<io::Error>().is_some_and(is_end))
}

// Decode characters of two bytes
/// The text of pairs of bytes that are UTF-16.
fn utf_8(
    bytes: &[u8],
    unit: fn([u8; 2]) -> u16,
) -> Result<Vec<u8>, String> {
    let (pairs, rest) = bytes.as_chunks::<2>();
    if !rest.is_empty() {
        return Err("the UTF-16 text ends within a letter".to_owned());
    }
    let units = pairs.iter().map(|&pair| unit(pair));
    let letters = char::decode_utf16(units)
        .map(|letter| letter.unwrap_or(char::REPLACEMENT_CHARACTER));
    Ok(letters.collect::<String>().into_bytes())
}
