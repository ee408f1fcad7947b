// Files that are compressed, in UTF-16, or end their lines otherwise
// (chapter "Files as they come").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use crate::prelude::*;

use flate2::{Compression, GzBuilder, write::GzEncoder};
use ruzstd::encoding::{CompressionLevel, compress_to_vec};

const TEXT: &str = "# a comment é\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n\
                    vt 0.25 0.75\nvt 0.25 0.75\nf 1 2 3 4\nf 1 2 3\n";

fn plain() -> Mesh {
    read_obj(TEXT.as_bytes()).unwrap()
}

fn complaint(bytes: &[u8]) -> String {
    read_file(bytes).unwrap_err().of_file("x").to_string()
}

pub fn gzip(text: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(vec![], Compression::default());
    encoder.write_all(text).unwrap();
    encoder.finish().unwrap()
}

pub fn zstd(text: &[u8]) -> Vec<u8> {
    compress_to_vec(text, CompressionLevel::Fastest)
}

pub fn utf_16(text: &str, bytes: fn(u16) -> [u8; 2]) -> Vec<u8> {
    let units = std::iter::once(0xfeff).chain(text.encode_utf16());
    units.flat_map(bytes).collect()
}

#[test]
fn a_compressed_text_is_the_text() {
    let (head, tail) = TEXT.as_bytes().split_at(40);
    for pack in [gzip, zstd] {
        assert_eq!(read_obj(&pack(TEXT.as_bytes())).unwrap(), plain());
        let parts = [pack(head), pack(tail)].concat();
        assert_eq!(read_obj(&parts).unwrap(), plain());
        let marked = ["\u{feff}".as_bytes(), TEXT.as_bytes()].concat();
        assert_eq!(read_obj(&pack(&marked)).unwrap(), plain());
        let wide = utf_16(TEXT, u16::to_le_bytes);
        assert_eq!(read_obj(&pack(&wide)).unwrap(), plain());
    }
}

#[test]
fn a_fault_in_a_compressed_text_has_its_line() {
    let wrong = TEXT.replace("v 1 1 0", "v 1 one 0");
    for pack in [gzip, zstd] {
        let words = "x:4: y = one is no number";
        assert_eq!(complaint(&pack(wrong.as_bytes())), words);
        let words = "x: the file is empty; an OBJ was expected";
        assert_eq!(complaint(&pack(b"")), words);
    }
}

/// A frame of zstd that decoders skip.
fn skipped(number: u8, content: &[u8]) -> Vec<u8> {
    let size = (content.len() as u32).to_le_bytes();
    let magic = [0x50 + number, 0x2a, 0x4d, 0x18];
    [&magic, &size, content].concat()
}

#[test]
fn what_a_packer_puts_around_a_text_is_no_part_of_it() {
    let (head, tail) = TEXT.as_bytes().split_at(40);
    let named =
        GzBuilder::new().filename("a b").comment("c").extra("AB\x01\0x");
    let mut named = named.write(vec![], Compression::default());
    named.write_all(tail).unwrap();
    let named = named.finish().unwrap();
    for parts in [
        vec![gzip(b""), gzip(head), gzip(b""), named, gzip(b"")],
        vec![gzip(TEXT.as_bytes()), vec![0; 99]],
        vec![gzip(head), vec![0; 9], gzip(tail), vec![0]],
        vec![skipped(0, b"abc"), zstd(head), skipped(15, b""), zstd(tail)],
        vec![zstd(b""), zstd(TEXT.as_bytes()), zstd(b""), skipped(3, b"a")],
        vec![zstd(TEXT.as_bytes()), vec![0; 3]],
        vec![gzip(head), zstd(tail)],
    ] {
        let (mesh, warnings) = read_file(&parts.concat()).unwrap();
        assert_eq!((mesh, warnings), (plain(), vec![]), "{parts:?}");
    }
    let cut = [zstd(TEXT.as_bytes()), skipped(1, b"abc")].concat();
    for end in 1..8 {
        let words = complaint(&cut[..cut.len() - end]);
        let fault = "zstd file is cut short at byte";
        assert!(words.contains(fault), "{words}");
    }
}

#[test]
fn what_follows_a_compressed_text_is_told() {
    let file = gzip(TEXT.as_bytes());
    let more = [&file[..], b"\0more"].concat();
    let (mesh, warnings) = read_file(&more).unwrap();
    assert_eq!(mesh, plain());
    let begin = file.len() + 1;
    let words = format!("no gzip from byte {begin} on: left out");
    assert_eq!(warnings.len(), 1);
    assert_eq!(warnings[0].text, words);
    let file = zstd(TEXT.as_bytes());
    let words = complaint(&[&file[..], b"more"].concat());
    let n = file.len();
    let place = format!("damaged at byte {n} in part 2, from {n} on");
    assert!(words.ends_with(&place), "{words}");
}

#[test]
fn what_is_packed_twice_is_read_and_what_is_packed_otherwise_is_named() {
    let twice = gzip(&zstd(TEXT.as_bytes()));
    assert_eq!(read_obj(&twice).unwrap(), plain());
    assert_eq!(read_obj(&gzip(&gzip(TEXT.as_bytes()))).unwrap(), plain());
    let tar = [&[b'a'; 257][..], b"ustar\x0000"].concat();
    for (file, name) in [
        (gzip(&twice), "zstd"),
        (b"PK\x03\x04\x14\0".to_vec(), "zip"),
        (b"\xfd7zXZ\0".to_vec(), "xz"),
        (b"BZh91AY&SY".to_vec(), "bzip2"),
        (b"\x04\x22\x4d\x18".to_vec(), "lz4"),
        (b"7z\xbc\xaf\x27\x1c".to_vec(), "7z"),
        (tar.clone(), "tar"),
        (gzip(&tar), "tar"),
    ] {
        let words = format!("x: the format is {name}: unpack it first");
        assert_eq!(complaint(&file), words);
    }
}

#[test]
fn no_message_has_the_names_of_a_decoder() {
    // A frame that needs a dictionary, and one with a window of 2 GiB.
    let block = b"\x01\0\0";
    let frame = |head: &[u8]| [b"\x28\xb5\x2f\xfd", head, block].concat();
    let words = complaint(&frame(b"\x01\0\x07"));
    assert!(words.contains("is packed with a dictionary at"), "{words}");
    let words = complaint(&frame(b"\0\xa8"));
    assert!(words.contains("a window of more than 128 MiB at"), "{words}");
}

/// A triangle and a comment, packed by `zstd --check`.
const CHECKED: &[u8] = include_bytes!("common/checked.obj.zst");

#[test]
fn a_compressed_file_that_is_cut_or_damaged_says_so() {
    for (kind, magic, file) in
        [("gzip", 2, gzip(TEXT.as_bytes())), ("zstd", 4, CHECKED.to_vec())]
    {
        assert!(read_obj(&file).is_ok());
        for end in magic..file.len() {
            let words = complaint(&file[..end]);
            let start = format!("x: the {kind} file is cut short at byte ");
            assert!(words.starts_with(&start), "{end}: {words}");
            assert!(words.ends_with(" in part 1, from 0 on"), "{words}");
        }
        let begin = file.len();
        let words = complaint(&[&file[..], &file[..begin - 2]].concat());
        let place = format!(" in part 2, from {begin} on");
        assert!(words.ends_with(&place), "{words}");
        let mut found = 0;
        let masks = [1, 2, 4, 8, 16, 32, 64, 128, 0x55];
        let places =
            (magic..file.len()).flat_map(|i| masks.map(|m| (i, m)));
        for (at, mask) in places {
            let mut file = file.clone();
            file[at] ^= mask;
            let Err(error) = read_file(&file) else { continue };
            let words = error.of_file("x").to_string();
            let start = format!("x: the {kind} file is ");
            assert!(words.starts_with(&start), "{at}: {words}");
            assert!(words.contains(" in part "), "{at}: {words}");
            assert!(!words.contains(['\n', '{', '_']), "{at}: {words}");
            found += usize::from(mask == 0x55);
        }
        // The head has a time and such, which may change.
        assert!(found + 12 > file.len(), "{kind}: {found}");
    }
}

#[test]
fn utf_16_is_read_in_either_order() {
    for bytes in [u16::to_le_bytes, u16::to_be_bytes] {
        assert_eq!(read_obj(&utf_16(TEXT, bytes)).unwrap(), plain());
        let windows = TEXT.replace('\n', "\r\n");
        assert_eq!(read_obj(&utf_16(&windows, bytes)).unwrap(), plain());
        let wrong = TEXT.replace("v 1 1 0", "v 1 1");
        let words = "x:4: a vertex without z";
        assert_eq!(complaint(&utf_16(&wrong, bytes)), words);
        let file = utf_16(TEXT, bytes);
        let words = "x: the UTF-16 text ends within a letter";
        assert_eq!(complaint(&file[..file.len() - 1]), words);
        // Two texts, each with its mark, and a padded one.
        let (head, tail) = TEXT.split_at(TEXT.find("v 1 1").unwrap());
        let tail = tail.to_owned() + "\x1a\r\n";
        let both = [utf_16(head, bytes), utf_16(&tail, bytes)].concat();
        for zeros in [0, 2, 64] {
            let padded = [&both[..], &vec![0; zeros]].concat();
            assert_eq!(read_obj(&padded).unwrap(), plain());
        }
        // Half of a pair, in a comment.
        let mut file = utf_16(&format!("#.\n{TEXT}"), bytes);
        file[4..6].copy_from_slice(&bytes(0xd800));
        assert_eq!(read_obj(&file).unwrap(), plain());
    }
}

#[test]
fn the_program_reads_compressed_files_and_pipes() {
    let place = Scratch::new();
    let small = format!("{} -d8x6 -n3 -r0.5", ABOVE.join(" "));
    let plain = place.feed(TEXT.as_bytes(), &small).succeeded();
    for (name, file) in [
        ("scene.obj.gz", gzip(TEXT.as_bytes())),
        ("scene.obj.zst", zstd(TEXT.as_bytes())),
        ("wide.obj", utf_16(TEXT, u16::to_le_bytes)),
    ] {
        place.put(name, &file);
        let run = place.done(&format!("{small} -i {name}"));
        assert_eq!(pgm(&run.stdout), pgm(&plain.stdout));
        place.feed(&file, &small).succeeded();
        let run = place.feed(&file[..file.len() - 1], &small);
        run.failed(1, &["standard input: the ", " "]);
    }
    // What comes late is read.
    let late = "# a word\n".repeat(1 << 21) + TEXT;
    let late = place.feed(late.as_bytes(), &small).succeeded();
    assert_eq!(late.stdout, plain.stdout);
}
