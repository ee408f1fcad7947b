// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! The formats of images: what is written comes back, what lies is
//! refused, and nothing that is damaged ends the program (chapter
//! "Images and their formats").

use crate::prelude::*;

use crate::render_loop::image_of;
use std::io::Error;

use exr::math::Vec2;
use exr::meta::attribute::{AttributeValue, IntegerBounds};
use exr::meta::header::{ImageAttributes, LayerAttributes};
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image as ExrImage,
    Layer, SmallVec, WritableImage, f16,
};
use litpt::film;
use png::BitDepth::{self, Eight, One, Sixteen};
use png::ColorType::{self, Grayscale, GrayscaleAlpha, Indexed, Rgb, Rgba};

/// An image of all that the formats can carry, with numbers that a
/// 32-bit number holds.
fn image() -> Image {
    let attributes = [
        ("seed", "7"),
        ("scene", "Höhle.obj"),
        ("stopped", ""),
        ("a_name_of_more_than_thirty_one_characters", "70"),
    ];
    let own = |(name, value): (&str, &str)| (name.into(), value.into());
    Image {
        errors: Some(vec![0., 0.125, 0.5, f64::INFINITY, 2., 0.25]),
        samples: Some(vec![4., 4., 16_777_217., 1., 4_294_967_295., 4.]),
        attributes: attributes.into_iter().map(own).collect(),
        ..Image::plain(3, 2, vec![0., 0.25, 0.5, 0.75, 1., 1.5])
    }
}

/// [`image`], and one whose pixels share random numbers.
fn images() -> [Image; 2] {
    let tile_errors = Some(vec![0.5, 0.5, 0.25, 0.25, f64::INFINITY, 0.]);
    [image(), Image { tile_errors, ..image() }]
}

pub fn decode(bytes: &[u8]) -> Result<Image, String> {
    Image::decode(bytes, &mut |_| ()).map_err(|e| e.to_string())
}

/// An image that is not as it should be, and what was said of it.
fn noted(bytes: &[u8]) -> (Image, String) {
    let mut notes = String::new();
    let image = Image::decode(bytes, &mut |note| notes += note).unwrap();
    (image, notes)
}

/// What must be refused is, in one line.
#[track_caller]
fn refuse(bytes: &[u8], words: &[&str]) {
    let message = decode(bytes).unwrap_err();
    assert!(!message.contains('\n'), "{message}");
    says(&message, words);
}

pub fn bytes(format: Format, image: &Image) -> Vec<u8> {
    let mut bytes = vec![];
    format.write(image, &mut bytes).unwrap();
    bytes
}

/// A portable float map of the given header.
fn pfm(header: &str, values: &[f32]) -> Vec<u8> {
    let mut bytes = header.as_bytes().to_vec();
    bytes.extend(values.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

#[track_caller]
fn close(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-6, "{found} {expected}");
    }
}

#[test]
fn an_exr_file_brings_back_all_that_was_written_and_no_more() {
    let attribute = |i: u32| (format!("name{i}"), i.to_string());
    let attributes: BTreeMap<_, _> = (0..20).map(attribute).collect();
    let [plain, shared] = images();
    let bare = Image { errors: None, samples: None, ..image() };
    for image in [plain, shared, bare, Image { attributes, ..image() }] {
        let written = bytes(Format::Exr, &image);
        assert_eq!(noted(&written), (image.clone(), String::new()));
        assert!((0..5).all(|_| bytes(Format::Exr, &image) == written));
        let named = |bytes: &[u8]| bytes == b"tile_stderr.Y\0";
        let named = written.windows(14).any(named);
        assert_eq!(named, image.tile_errors.is_some());
    }
    let many = Image { samples: Some(vec![5e9; 6]), ..image() };
    let read = decode(&bytes(Format::Exr, &many)).unwrap();
    assert_eq!(read.samples, Some(vec![4_294_967_295.; 6]));
}

/// A film without attributes.
pub fn unnamed(film: &Film) -> Picture<'_> {
    let (more, attributes) = (vec![], BTreeMap::new());
    Picture { film, allocation: None, more, attributes }
}

/// A film is written block by block, most of which may be gaps.
#[test]
fn an_exr_file_of_a_film_is_that_of_its_image() {
    let window = film::Window { corner: (9, 20), size: (300, 150) };
    // Threads may meet the first gap at the same time.
    for gaps in [true; 9].into_iter().chain([false]) {
        let film = Film::cropped((400, 400), window, false);
        let mut film = film.with_net_size(4).with_shared_tiles();
        let tiles = film.tiles().into_iter().enumerate();
        for (i, FilmTile { pixels, mut mean, .. }) in
            tiles.filter(|t| !gaps || t.0 < 9)
        {
            for k in 0..2 + i % 3 {
                let values = (0..).map(|n| f64::from(n * n % 7 + k as u32));
                let pixels = pixels.iter_mut().zip(values);
                pixels.for_each(|(pixel, value)| pixel.add(value));
                mean.as_mut().unwrap().add((i * k) as f64);
            }
        }
        let mut written = vec![];
        let picture = unnamed(&film);
        Format::Exr.write(&picture, &mut written).unwrap();
        let image = picture.image();
        assert!(written == bytes(Format::Exr, &image));
        let errors = film.errors(NEIGHBOUR_WEIGHT, film.window);
        assert_eq!(image.errors.unwrap(), errors);
        // Blocks without a sample stand where they belong.
        let read = noted(&written).0;
        let same = |(&a, &b): (&f64, &f64)| {
            f64::from(a as f32) == b || a.is_nan() && b.is_nan()
        };
        assert!(image.means.iter().zip(&read.means).all(same));
        assert_eq!(image.samples, read.samples);
    }
}

/// Any bit: of an attribute, of a number, or of the file's own tables.
#[test]
fn a_flipped_bit_of_an_exr_file_is_refused_or_told() {
    for image in images() {
        let mut written = bytes(Format::Exr, &image);
        let mut refused = 0;
        for at in 0..8 * written.len() {
            written[at / 8] ^= 1 << (at % 8);
            let mut notes = String::new();
            if Image::decode(&written, &mut |note| notes += note).is_ok() {
                let told = notes.contains("changed after pt wrote it");
                assert!(told, "bit {at}: {notes}");
            } else {
                refuse(&written, &[]);
                refused += 1;
            }
            written[at / 8] ^= 1 << (at % 8);
        }
        assert!(refused > written.len(), "{refused}");
    }
}

#[test]
fn a_float_map_holds_its_rows_from_the_bottom_up() {
    let expected = pfm("Pf\n3 2\n-1.0\n", &[0.75, 1., 1.5, 0., 0.25, 0.5]);
    assert_eq!(bytes(Format::Pfm, &image()), expected);
    let read = decode(&expected).unwrap();
    assert_eq!(read.means, image().means);
    assert_eq!((read.errors, read.samples), (None, None));
}

/// As other programs write them, down to one line for all of it.
#[test]
fn float_maps_are_read_in_all_their_forms() {
    let values = [0.25, 0.5, 0.75, 1.];
    let longer = "its last 1 bytes are ignored";
    for (header, end, told) in [
        ("Pf\r\n2 2\r\n-1.0\r\n", "", ""),
        ("Pf 2 2 -1e0 ", "", ""),
        ("Pf\t2  2\n\n -1\n", "", ""),
        ("Pf\n# a comment\n2 2 # another\n-1\n", "", ""),
        ("Pf\n2 2\n-1 \n", "", ""),
        ("Pf\n2 2\n-1#\n", "", ""),
        ("Pf\n2 2\n-1\n# a comment\n", "", ""),
        ("Pf\n2 2\n-1\n", "\n", longer),
        ("Pf 2 2 -1 # a comment\r\n", "\n", longer),
    ] {
        let map = [&pfm(header, &values), end.as_bytes()].concat();
        let (image, notes) = noted(&map);
        assert_eq!(image.means, [0.75, 1., 0.25, 0.5], "{header:?}");
        assert_eq!(notes, told);
    }
    for kind in ["Pf4", "PF2", "Pf\u{e4}"] {
        let map = pfm(&format!("{kind}\n1 1\n-1\n"), &values);
        refuse(&map, &[&format!("its kind is {kind}, not PF")]);
    }
    // Of either order and any scale, and of numbers like white space.
    for (header, pixel, mean) in [
        ("Pf 1 1 2.0\n", 3f32.to_be_bytes(), 6.),
        ("Pf\n1 1\n+1.000000\n", 0.5f32.to_be_bytes(), 0.5),
        ("Pf\n1 1\n-1\n", *b"\n \n?", f32::from_le_bytes(*b"\n \n?")),
    ] {
        let map = [header.as_bytes(), &pixel].concat();
        assert_eq!(decode(&map).unwrap().means, [f64::from(mean)]);
    }
}

#[test]
fn files_of_other_kinds_are_refused_with_the_reason() {
    let jpeg = b"\xff\xd8\xff\xe0\0\x10JFIF\0";
    for other in [&b"P6 1 1 255 abc"[..], b"v 0 0 0", b"", jpeg] {
        refuse(other, &["neither EXR, PFM, PNG nor PGM"]);
    }
    let place = tempfile::tempdir().unwrap();
    let message = Image::read(&place.path().join("none.exr"));
    let message = message.unwrap_err().to_string();
    assert!(message.contains("none.exr: cannot read"), "{message}");
}

/// The luminance of three radiances, after Rec. ITU-R BT.709.
fn luminance([r, g, b]: [f64; 3]) -> f64 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

#[test]
fn of_colours_the_luminance_is_taken_and_said() {
    let channels = [("R", 0.25), ("G", 0.5), ("B", 0.75), ("A", 1.)];
    let half = |x: f32| FlatSamples::F16(vec![f16::from_f32(x); 2]);
    let file = foreign(&channels.map(|(name, x)| (name, half(x))));
    let lower = luminance([0.25, 0.5, 0.75]);
    let upper = luminance([1., 0., 2.]);
    let values = [0.25, 0.5, 0.75, 1., 0., 2.];
    for (file, expected) in [
        (pfm("PF\n1 2\n-1\n", &values), &[upper, lower][..]),
        (pfm("PF4\n1 1\n-1\n", &values[..4]), &[lower]),
        (file, &[lower; 2]),
    ] {
        let (image, notes) = noted(&file);
        close(&image.means, expected);
        assert!(image.errors.is_none() && image.attributes.is_empty());
        assert!(notes.contains("luminance is taken (0.2126 R + 0.7152 G"));
    }
}

/// The radiance of a level (IEC 61966-2-1).
fn radiance(level: f64) -> f64 {
    match level <= 0.04045 {
        true => level / 12.92,
        false => ((level + 0.055) / 1.055).powf(2.4),
    }
}

#[test]
fn grey_levels_of_other_programs_are_radiances_of_the_srgb_curve() {
    let levels = [0., 51. / 255., 1.].map(radiance);
    for file in [
        &b"P2\n# a comment\n3 1 # another\n255\n0 51\n255\n"[..],
        b"P5 3 1 255\n\0\x33\xff",
        b"P5\n3 1\n65535\n\0\0\x33\x33\xff\xff",
        b"P5\r\n3 1\r\n255\r\n\0\x33\xff",
        b"P5 3 1#\n255 # a comment\n\0\x33\xff",
        b"P5 3 1\n255\n# a comment\n\0\x33\xff",
        b"P2 3 1\n255# a comment\n\n0 51#\n255",
    ] {
        let (image, notes) = noted(file);
        assert_eq!((image.width, image.height), (3, 1));
        close(&image.means, &levels);
        assert!(image.errors.is_none() && notes.contains("sRGB curve"));
    }
    for (file, words) in [
        (&b"P2 2 1 255 7"[..], &["1 levels", "says 2"][..]),
        (b"P2 2 1 255 7 7 7", &["3 levels", "says 2"]),
        (b"P5 3 1 255\n12", &["2 bytes", "says 3"]),
        (b"P5 4294967295 4294967295 255\n1", &["1 bytes"]),
        (b"P2 2 1 255 7 x", &["no number"]),
        (b"P2 0 1 255", &["header"]),
        (b"P5 2 1 0\n12", &["header"]),
    ] {
        refuse(file, words);
    }
}

/// Levels may look like line ends and comments.
#[test]
fn what_follows_the_levels_is_ignored_and_said() {
    for levels in [b"\n\n\n", b"#\n3", b" \n\r"] {
        let expected = levels.map(|level| radiance(level as f64 / 255.));
        let whole = [b"P5 3 1 255\n", &levels[..]].concat();
        for more in [&b""[..], b"\n", &whole] {
            let (image, notes) = noted(&[&whole, more].concat());
            close(&image.means, &expected);
            let words = format!("last {} bytes are ignored", more.len());
            assert_eq!(notes.contains(&words), !more.is_empty(), "{notes}");
        }
    }
}

/// A PNG file of so many pixels, with these chunks.
fn png(
    (kind, depth): (ColorType, BitDepth),
    (width, height): (u32, u32),
    chunks: &[(&[u8; 4], &[u8])],
    data: &[u8],
) -> Vec<u8> {
    let mut bytes = vec![];
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(kind);
    encoder.set_depth(depth);
    if kind == Indexed {
        encoder.set_palette(&[255, 0, 0, 0, 0, 51]);
    }
    let mut writer = encoder.write_header().unwrap();
    for (kind, data) in chunks {
        writer.write_chunk(png::chunk::ChunkType(**kind), data).unwrap();
    }
    writer.write_image_data(data).unwrap();
    writer.finish().unwrap();
    bytes
}

#[test]
fn levels_of_a_png_file_have_the_curve_that_it_says() {
    let gamma = |value: u32| value.to_be_bytes();
    let (linear, usual) = (&gamma(100_000)[..], &gamma(45_455)[..]);
    let (none, huge) = (&gamma(0)[..], &gamma(u32::MAX)[..]);
    let icc = &b"A profile\0\0\x78\x9c\x03\0\0\0\0\x01"[..];
    let srgb = (b"sRGB", &[0][..]);
    let coded = |transfer| [1, transfer, 0, 1];
    let (straight, curved) = (&coded(8)[..], &coded(13)[..]);
    let level = 32768. / 65535.;
    let (curve, power) = (radiance(level), level.powf(1. / 0.45455));
    type Chunks<'a> = &'a [(&'a [u8; 4], &'a [u8])];
    let files: [(Chunks, f64, &str); 12] = [
        (&[], curve, "sRGB curve"),
        (&[srgb, (b"gAMA", linear)], curve, "sRGB curve"),
        (&[(b"gAMA", usual)], power, "a gamma of 0.45455"),
        (&[(b"gAMA", linear)], level, "a gamma of 1"),
        (&[(b"gAMA", none)], curve, "sRGB curve"),
        (&[(b"gAMA", huge)], curve, "its chunk gAMA is ignored"),
        (&[(b"iCCP", icc)], curve, "its chunk iCCP is ignored"),
        (&[(b"iCCP", icc), (b"gAMA", linear)], level, "iCCP is ignored"),
        (&[(b"cICP", straight), srgb], level, "a gamma of 1"),
        (&[(b"cICP", curved), (b"gAMA", linear)], curve, "sRGB curve"),
        (&[(b"cICP", &coded(16))], curve, "its chunk cICP is ignored"),
        (&[(b"tEXt", b"a\0gAMA"), srgb], curve, "sRGB curve"),
    ];
    for (chunks, expected, words) in files {
        let half = [128, 0].repeat(64);
        let grey = (Grayscale, Sixteen);
        let (image, notes) = noted(&png(grey, (8, 8), chunks, &half));
        close(&image.means, &[expected; 64]);
        assert!(notes.contains(words), "{words:?} not in {notes}");
        let ignored = words.contains("ignored");
        assert_eq!(notes.contains("ignored"), ignored, "{notes}");
    }
}

#[test]
fn png_files_of_all_kinds_are_read() {
    let written = bytes(Format::Png, &image());
    let clamped = image().means.into_iter().map(|mean| mean.min(1.));
    let read = decode(&written).unwrap().means;
    for (read, mean) in read.iter().zip(clamped) {
        assert!((read - mean).abs() < 1e-4, "{read} {mean}");
    }
    let fifth = radiance(0.2);
    let greys = [fifth, 1.];
    let colours = [luminance([1., 0., 0.]), luminance([0., 0., fifth])];
    let red_and_blue = [255, 0, 0, 7, 0, 0, 51, 255];
    let rgb = [255, 0, 0, 0, 0, 51];
    for (kind, depth, data, expected) in [
        (Grayscale, Eight, &[51, 255][..], greys),
        (Grayscale, One, &[0x40], [0., 1.]),
        (GrayscaleAlpha, Eight, &[51, 9, 255, 255], greys),
        (Rgb, Eight, &rgb, colours),
        (Indexed, Eight, &[0, 1], colours),
        (Rgba, Eight, &red_and_blue, colours),
    ] {
        let (image, notes) = noted(&png((kind, depth), (2, 1), &[], data));
        close(&image.means, &expected);
        assert!(notes.contains("sRGB curve"), "{notes}");
    }
    for length in 0..written.len() - 12 {
        assert!(decode(&written[..length]).is_err(), "{length}");
    }
}

/// A window of an EXR file: column and row of its first pixel, and its
/// size.
type Window = ((i32, i32), (usize, usize));

/// A part of a file: a channel, whose values tell the pixel.
fn part((position, size): Window) -> Layer<AnyChannels<FlatSamples>> {
    let rows = (position.1..).take(size.1);
    let columns = (position.0..).take(size.0);
    let pixels = rows.flat_map(|y| columns.clone().map(move |x| at(x, y)));
    let values = pixels.map(|value| value as f32).collect();
    let channel = AnyChannel::new("Y", FlatSamples::F32(values));
    let channels = AnyChannels::sort(SmallVec::from_vec(vec![channel]));
    let named = LayerAttributes::named(&*format!("{position:?}"));
    let named = named.with_position(Vec2(position.0, position.1));
    Layer::new(size, named, Encoding::UNCOMPRESSED, channels)
}

/// A file of this display window, whose parts have these data windows.
pub fn windowed((position, size): Window, parts: &[Window]) -> Vec<u8> {
    let bounds = IntegerBounds::new(Vec2(position.0, position.1), size);
    let parts: Vec<_> = parts.iter().copied().map(part).collect();
    let file = ExrImage::from_layers(ImageAttributes::new(bounds), parts);
    let mut bytes = vec![];
    file.write().to_buffered(Cursor::new(&mut bytes)).unwrap();
    bytes
}

fn at(x: i32, y: i32) -> f64 {
    f64::from(100 * y + x) / 2.
}

#[test]
fn the_display_window_of_an_exr_file_is_what_is_read() {
    let display: Window = ((-2, 3), (4, 3));
    let other = ((7, 7), (2, 2));
    for (data, told) in [
        (display, ""),
        (((-2, 3), (3, 2)), "-2,3,3x2"),
        (((-4, 1), (9, 9)), "-4,1,9x9"),
        (((-1, 3), (4, 3)), "-1,3,4x3"),
        (((-3, 4), (2, 5)), "-3,4,2x5"),
        (((70, 70), (1, 1)), "70,70,1x1"),
    ] {
        let (image, notes) = noted(&windowed(display, &[data, other]));
        assert_eq!((image.width, image.height), (4, 3));
        for (i, &mean) in image.means.iter().enumerate() {
            let (x, y) = (i as i32 % 4 - 2, i as i32 / 4 + 3);
            let ((left, top), (width, height)) = data;
            let inside = (left..left + width as i32).contains(&x)
                && (top..top + height as i32).contains(&y);
            assert_eq!(mean.is_nan(), !inside, "{x},{y} of {data:?}");
            assert!(!inside || mean == at(x, y), "{x},{y} of {data:?}");
        }
        assert_eq!(notes.contains("data window"), data != display);
        assert!(notes.contains(told), "{notes}");
        assert!(told.is_empty() || notes.contains("-2,3,4x3"), "{notes}");
    }
}

/// A file of two pixels, as another program may write it.
fn foreign(channels: &[(&str, FlatSamples)]) -> Vec<u8> {
    let channel = |(name, values): &(&str, FlatSamples)| {
        AnyChannel::new(*name, values.clone())
    };
    let channels = channels.iter().map(channel).collect();
    let channels = AnyChannels::sort(channels);
    let mut image = ExrImage::from_channels((2, 1), channels);
    let seed = ("other:seed".into(), AttributeValue::F32(7.));
    image.layer_data.attributes.other.extend([seed]);
    let mut bytes = vec![];
    image.write().to_buffered(Cursor::new(&mut bytes)).unwrap();
    bytes
}

#[test]
fn numbers_of_any_type_are_read_and_foreign_attributes_left_out() {
    let means = FlatSamples::F16(vec![f16::ONE; 2]);
    let counts = FlatSamples::F32(vec![9.; 2]);
    let written = foreign(&[("Y", means), ("samples.Y", counts)]);
    assert!(written.windows(10).any(|w| w == b"other:seed"));
    let (read, notes) = noted(&written);
    assert_eq!(read.means, [1.; 2]);
    assert_eq!(read.samples, Some(vec![9.; 2]));
    assert!(read.attributes.is_empty() && notes.is_empty(), "{notes}");
    let depth = foreign(&[("Z", FlatSamples::F32(vec![1.; 2]))]);
    refuse(&depth, &["neither a channel Y nor R, G", "but Z"]);
}

#[test]
fn pixels_that_are_no_numbers_are_counted_and_left_out() {
    for value in [f32::NAN, f32::INFINITY] {
        let map = pfm("Pf\n2 2\n-1\n", &[0., value, 0.5, value]);
        let (image, notes) = noted(&map);
        let lost: Vec<_> = image.means.iter().map(|x| x.is_nan()).collect();
        assert_eq!(lost, [false, true, false, true]);
        assert!(notes.contains("numbers: 2, the first at 1,0"), "{notes}");
    }
    for (k, value) in [(0, f64::NAN), (1, f64::NAN), (1, -1.), (0, -1.)] {
        let odd = Some(vec![0.5, 0.5, 0.5, 0.5, value, 0.5]);
        let mut image = images()[k].clone();
        let list = [&mut image.errors, &mut image.tile_errors];
        *list.into_iter().nth(k).unwrap() = odd;
        let file = bytes(Format::Exr, &image);
        if value < 0. {
            refuse(&file, &["standard error", "pixel 1,1 is -1"]);
            continue;
        }
        let (read, notes) = noted(&file);
        assert!(notes.contains("numbers: 1, the first at 1,1"), "{notes}");
        assert!(read.means[4].is_nan());
        assert_eq!(read.errors.unwrap()[4], f64::INFINITY);
        assert_eq!(read.samples.unwrap()[4], 0.);
    }
    let nothing = FlatSamples::F32(vec![4., f32::NAN]);
    let means = FlatSamples::F32(vec![1.; 2]);
    let file = foreign(&[("Y", means), ("samples.Y", nothing)]);
    let (read, _) = noted(&file);
    assert!(read.means[0] == 1. && read.means[1].is_nan());
    assert_eq!(read.samples, Some(vec![4., 0.]));
}

#[test]
fn a_header_that_promises_more_than_the_file_holds_is_refused() {
    let huge = "Pf\n1000000000 1000000000\n-1\n";
    refuse(&pfm(huge, &[1.]), &["4 bytes", "4000000000000000000"]);
    refuse(&pfm("Pf\n4294967295 4294967295\n-1\n", &[]), &["bytes"]);
    refuse(&pfm("Pf\n1 2\n-1\n", &[1.]), &["4 bytes", "8"]);
    for header in ["Pf 0 1 -1\n", "Pf 1 1 0\n", "Pf 1 1 NaN\n", "Pf"] {
        refuse(&pfm(header, &[]), &[]);
    }
    for window in ["dataWindow\0box2i\0", "displayWindow\0box2i\0"] {
        let mut exr = bytes(Format::Exr, &image());
        let mut places = exr.windows(window.len());
        let start = places.position(|w| w == window.as_bytes()).unwrap();
        // After the name and the type: the size, and four corners.
        let corner = start + window.len() + 4 + 8;
        exr[corner..corner + 4]
            .copy_from_slice(&999_999_999u32.to_le_bytes());
        refuse(&exr, &["window", "1000000000 by 2"]);
    }
}

/// A damaged file may still be one that makes sense; what it must not do
/// is to end the program.
#[test]
fn damaged_files_never_end_the_program() {
    let both = [Format::Exr, Format::Pfm].map(|f| bytes(f, &image()));
    for whole in &both {
        (0..whole.len()).for_each(|length| refuse(&whole[..length], &[]));
    }
    let [whole, map] = both;
    let mut random = Pcg64Mcg::seed_from_u64(2026);
    let mut refused = 0;
    for i in 0..10_000 {
        let mut damaged = if i % 10 == 0 { &map } else { &whole }.clone();
        for _ in 0..random.random_range(1..4) {
            let at = random.random_range(0..damaged.len());
            damaged[at] = random.random();
        }
        refused += u32::from(decode(&damaged).is_err());
    }
    assert!(refused > 1000 && refused < 9999, "{refused}");
}

#[test]
fn the_extension_tells_the_format() {
    for (name, format) in [
        ("a.b/c", Format::Pgm),
        ("c.PGM", Format::Pgm),
        ("c.png", Format::Png),
        ("c.Pfm", Format::Pfm),
        ("c.exr", Format::Exr),
    ] {
        assert_eq!(Format::of(name.as_ref()).unwrap(), format);
    }
    let message = Format::of("c.jpg".as_ref()).unwrap_err().to_string();
    assert!(message.contains("c.jpg") && message.contains(".exr"));
    let format = format_of("a.exr".as_ref(), Format::Pgm).unwrap();
    assert_eq!(format, Format::Exr);
}

#[test]
fn a_target_is_rewritten_whole_and_only_after_it_was_ours() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("report");
    let mut place = OutputTarget::file(&path, false).unwrap();
    let mut other = place.clone();
    let there = || fs::read_to_string(&path).unwrap();
    for state in ["first state", "second"] {
        place.rewrite(&mut |out| write!(out, "{state}")).unwrap();
        assert_eq!(there(), state);
    }
    let refused = other.rewrite(&mut |out| write!(out, "other"));
    assert!(refused.unwrap_err().to_string().contains("-f"));
    let failed = place.rewrite(&mut |out| {
        write!(out, "ha")?;
        Err(Error::other("no more"))
    });
    let fault = failed.unwrap_err().to_string();
    says(&fault, &["cannot write: no more"]);
    assert_eq!(there(), "second");
    place.write(&mut |out| write!(out, "last")).unwrap();
    assert_eq!(there(), "last");
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1);
}

#[cfg(unix)]
#[test]
fn a_device_receives_the_last_state_alone() {
    let mut place = OutputTarget::file("/dev/null".as_ref(), true).unwrap();
    let mut states = 0;
    let mut count = |_: &mut dyn Write| {
        states += 1;
        Ok(())
    };
    place.rewrite(&mut count).unwrap();
    place.write(&mut count).unwrap();
    assert_eq!(states, 1);
}

// Of 5 by 4 squares of 16 pixels, two are known: one of 0.25, one of 1. The
// others have the mean of the smallest larger square with a known one.
#[test]
fn pixels_without_a_sample_are_filled_in_levels_and_no_numbers_elsewhere() {
    let film = image_of((70, 50), |x, y| match (x / 16, y / 16) {
        (0, 0) => vec![0.25],
        (3, 2) => vec![1.],
        _ => vec![],
    });
    let expected = |x: usize, y: usize| match (x / 32, y / 32) {
        (0, 0) => (0.25, 136),
        (1, 1) => (1., 255),
        _ => (0.625, 207),
    };
    let image = unnamed(&film).image();
    let (.., levels) = pgm(&bytes(Format::Pgm, &image));
    let fine = decode(&bytes(Format::Png, &image)).unwrap().means;
    let pfm = decode(&bytes(Format::Pfm, &image)).unwrap();
    let (exr, said) = noted(&bytes(Format::Exr, &image));
    for i in 0..3500 {
        let (x, y) = (i % 70, i / 70);
        let (exact, level) = expected(x, y);
        assert_eq!(levels[i], level, "{x},{y}");
        assert!((fine[i] - exact).abs() < 4e-5, "{} at {x},{y}", fine[i]);
        let known = film.pixel(x as u32, y as u32).count() > 0;
        assert_eq!(pfm.means[i].is_nan(), !known);
        assert_eq!(exr.means[i].is_nan(), !known);
        let count = if known { 1. } else { 0. };
        assert_eq!(exr.samples.as_ref().unwrap()[i], count);
    }
    assert!(said.contains("not finite numbers: 2988"), "{said}");
}
