// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later
//! OpenEXR: channels `Y`, `stderr.Y`, `samples.Y` and, if pixels share random
//! numbers, `tile_stderr.Y`; and attributes.

use std::collections::BTreeMap;
use std::io::{self, Cursor, Write};

use exr::math::Vec2;
use exr::meta::MetaData;
use exr::meta::attribute::{AttributeValue, LineOrder, Text};
use exr::meta::header::LayerAttributes;
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples,
    Image as ExrImage, Layer, Sample, SmallVec,
};
use exr::prelude::{ReadChannels, ReadLayers, WritableImage};
use sha2::{Digest, Sha256};

use super::data::{Image, Note, room};
use super::srgb::{COLOURS, mean};

/// Writes all that the image holds.
pub fn write(image: &Image, out: &mut dyn Write) -> io::Result<()> {
    let size = (image.width as usize, image.height as usize);
    let checksum = (&CHECKSUM.to_owned(), &checksum(image));
    let all = image.attributes.iter().chain([checksum]);
    let other = all.map(attribute).collect();
    let layer = LayerAttributes { other, ..LayerAttributes::default() };
    // Compress sixteen rows at a time
    let encoding = Encoding {
        compression: Compression::ZIP16,
        blocks: Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    };
    let channels = AnyChannels::sort(channels(image));
    let layer = Layer::new(size, layer, encoding, channels);
    // Encode the layer in memory
    let mut bytes = Vec::new();
    ExrImage::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(Cursor::new(&mut bytes))
        .map_err(io::Error::other)?;
    sort_attributes(&mut bytes);
    out.write_all(&bytes)
}

/// The channels that the image fills.
fn channels(image: &Image) -> SmallVec<[AnyChannel<FlatSamples>; 4]> {
    let real = |name: &str, values: &Vec<f64>| {
        let values = values.iter().map(|&value| value as f32).collect();
        AnyChannel::new(name, FlatSamples::F32(values))
    };
    let whole = |name: &str, values: &Vec<f64>| {
        let values = values.iter().map(|&value| value as u32).collect();
        AnyChannel::new(name, FlatSamples::U32(values))
    };
    let errors = image.errors.as_ref().map(|e| real(ERROR, e));
    let samples = image.samples.as_ref().map(|n| whole(SAMPLES, n));
    let shared = image.tile_errors.as_ref().map(|e| real(SHARED, e));
    let means = Some(real(MEAN, &image.means));
    [means, errors, samples, shared].into_iter().flatten().collect()
}

const MEAN: &str = "Y";
const ERROR: &str = "stderr.Y";
const SAMPLES: &str = "samples.Y";
const SHARED: &str = "tile_stderr.Y";
/// What the names of our attributes begin with.
const PREFIX: &str = "litpt:";

fn attribute((name, value): (&String, &String)) -> (Text, AttributeValue) {
    let text = |text: &str| Text::from_slice_unchecked(text.as_bytes());
    let name = text(&format!("{PREFIX}{name}"));
    (name, AttributeValue::Text(text(value)))
}

/// Sorts the attributes in the header of a file of one part by name.
fn sort_attributes(file: &mut [u8]) {
    let mut rest = &file[8..];
    let mut attributes = Vec::new();
    while let Some(length) = attribute_length(rest) {
        let (attribute, others) = rest.split_at(length);
        attributes.push(attribute);
        rest = others;
    }
    attributes.sort();
    let sorted = attributes.concat();
    file[8..8 + sorted.len()].copy_from_slice(&sorted);
}

/// The length of the first attribute, unless the header ends here.
fn attribute_length(header: &[u8]) -> Option<usize> {
    let text = |from: usize| {
        let length = header[from..].iter().position(|&byte| byte == 0)?;
        (length > 0).then_some(from + length + 1)
    };
    let size_at = text(text(0)?)?;
    let size = header[size_at..].first_chunk()?;
    Some(size_at + 4 + u32::from_le_bytes(*size) as usize)
}

/// The attribute that holds the checksum.
const CHECKSUM: &str = "checksum";

/// SHA-256 of all that a file brings back, in hexadecimal digits.
fn checksum(image: &Image) -> String {
    let mut sum = Sha256::new();
    // Add the size and the channels to the checksum
    sum.update(image.width.to_le_bytes());
    sum.update(image.height.to_le_bytes());
    for channel in channels(image) {
        sum.update(channel.name.as_slice());
        match &channel.sample_data {
            FlatSamples::U32(values) => {
                values.iter().for_each(|n| sum.update(n.to_le_bytes()));
            }
            others => others
                .values_as_f32()
                .for_each(|x| sum.update(x.to_le_bytes())),
        }
    }
    for (name, value) in &image.attributes {
        for text in [name, value] {
            sum.update((text.len() as u64).to_le_bytes());
            sum.update(text);
        }
    }
    let hex = |byte: u8| format!("{byte:02x}");
    sum.finalize().into_iter().map(hex).collect()
}

/// Reads the first layer of a file that has the channel `Y` or colours;
/// `bytes` is the whole file. `note` is told of colours, and of windows
/// that differ.
///
/// # Errors
/// The file is damaged, or it has neither in full size.
pub fn read(bytes: &[u8], note: Note) -> Result<Image, String> {
    refuse_lies(bytes)?;
    // Decode the first layer of the file
    let film = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(|error| error.to_string())?;
    let layer = film.layer_data;
    // Lay the data window over the display window
    let data = layer.absolute_bounds();
    let display = film.attributes.display_window;
    if data != display {
        let [data, display] = [data, display].map(|window| {
            let (Vec2(x, y), Vec2(w, h)) = (window.position, window.size);
            format!("{x},{y},{w}x{h}")
        });
        note(&format!(
            "its data window {data} is not its display window {display}: \
             it is read as the latter, with what the former has of it"
        ));
    }
    let Vec2(right, down) = display.position - data.position;
    let place = |i: usize| {
        let x = (i % display.size.0).wrapping_add_signed(right as isize);
        let y = (i / display.size.0).wrapping_add_signed(down as isize);
        (x < data.size.0 && y < data.size.1).then(|| x + y * data.size.0)
    };
    // Require the channel of the means
    let pixels = 0..display.size.area();
    let values = |name: &str| -> Option<Vec<f64>> {
        let list = &layer.channel_data.list;
        let channel = list.iter().find(|channel| channel.name.eq(name))?;
        let samples = &channel.sample_data;
        let value = |at| match samples.value_by_flat_index(at) {
            Sample::U32(whole) => whole.into(),
            real => real.to_f32().into(),
        };
        let value = |i| place(i).map_or(f64::NAN, value);
        let whole = samples.len() == layer.size.area();
        whole.then(|| pixels.clone().map(value).collect())
    };
    let coloured = || {
        let colours = [values("R")?, values("G")?, values("B")?];
        let pixel = |i| mean(&[0, 1, 2].map(|k: usize| colours[k][i]));
        note(COLOURS);
        Some(pixels.clone().map(pixel).collect())
    };
    let means = values(MEAN).or_else(coloured).ok_or_else(|| {
        // Say which channels there are instead
        let list = layer.channel_data.list.iter();
        let names: Vec<_> = list.map(|c| c.name.to_string()).collect();
        let names = names.join(", ");
        format!("it has neither a channel Y nor R, G and B, but {names}")
    })?;
    let attributes = layer.attributes.other.iter().filter_map(ours);
    let mut attributes: BTreeMap<_, _> = attributes.collect();
    let stated = attributes.remove(CHECKSUM);
    let side = |n| u32::try_from(n).map_err(|_| "it is too large");
    let image = Image {
        width: side(display.size.width())?,
        height: side(display.size.height())?,
        means,
        errors: values(ERROR),
        samples: values(SAMPLES),
        tile_errors: values(SHARED),
        attributes,
    };
    // Compare the checksum with the stated one
    let wrong = match stated {
        Some(stated) => data != display || stated != checksum(&image),
        None => !image.attributes.is_empty(),
    };
    if wrong {
        return Err("its checksum is wrong: it is damaged, or another \
                    program has changed it"
            .to_owned());
    }
    Ok(image)
}

/// Refuses a header that promises more pixels than the file can hold.
fn refuse_lies(bytes: &[u8]) -> Result<(), String> {
    let meta = MetaData::read_from_buffered(bytes, false)
        .map_err(|error| error.to_string())?;
    for header in &meta.headers {
        // Refuse windows for which there is no room
        let display = header.shared_attributes.display_window.size;
        let pixel = header.channels.bytes_per_pixel;
        let windows = [(header.layer_size, pixel, 1), (display, 8, 8)];
        for (Vec2(width, height), pixel, factor) in windows {
            let size = width as u128 * height as u128 * pixel as u128;
            if !room(size, factor * bytes.len()) {
                return Err(format!(
                    "its header says a window of {width} by {height} pixels, \
                     which a file of {} bytes cannot have",
                    bytes.len()
                ));
            }
        }
    }
    Ok(())
}

/// The name and value of an attribute if it is one of ours.
fn ours(
    (name, value): (&Text, &AttributeValue),
) -> Option<(String, String)> {
    let AttributeValue::Text(value) = value else { return None };
    let string =
        |text: &Text| String::from_utf8_lossy(text.as_slice()).into_owned();
    let name = string(name).strip_prefix(PREFIX)?.to_owned();
    Some((name, string(value)))
}
