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
use std::sync::OnceLock;

use bytemuck::cast_slice;
use exr::block::chunk::{Chunk, CompressedBlock};
use exr::block::writer::ChunksWriter;
use exr::block::{
    BlockIndex, UncompressedBlock, enumerate_ordered_header_block_indices,
};
use exr::error::Error;
use exr::math::{RoundingMode, Vec2};
use exr::meta::attribute::{
    AttributeValue, ChannelDescription, LevelMode, LineOrder, SampleType,
    Text, TileDescription,
};
use exr::meta::header::{Header, LayerAttributes};
use exr::meta::{BlockDescription, MetaData};
use exr::prelude::{Compression, ReadChannels, ReadLayers, Sample};
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use super::data::{Image, Note, Source, room};
use super::srgb::{COLOURS, mean};
use crate::film::Window;

/// Writes all that the image holds.
pub fn write(image: &dyn Source, out: &mut dyn Write) -> io::Result<()> {
    let (mut file, mut hashes) = (Cursor::new(vec![]), vec![]);
    let headers = [header(image)].into_iter().collect();
    exr::block::write(&mut file, headers, true, |meta, writer| {
        let blocks = enumerate_ordered_header_block_indices(&meta.headers);
        let (blocks, gap) = (Vec::from_iter(blocks), OnceLock::new());
        for blocks in blocks.chunks(BATCH) {
            let compress = |&(number, index)| {
                let done = compress(image, index, &meta.headers, &gap);
                done.map(|(chunk, hash)| (number, chunk, hash))
            };
            let chunks = blocks.par_iter().map(compress);
            for (number, chunk, hash) in
                chunks.collect::<Result<Vec<_>, Error>>()?
            {
                writer.write_chunk(number, chunk)?;
                hashes.push(hash);
            }
        }
        Ok(())
    })
    .map_err(io::Error::other)?;
    let mut bytes = file.into_inner();
    finish_attributes(&mut bytes, &checksum(image, &hashes));
    out.write_all(&bytes)
}

/// A block and its checksum; all that are `gap` are copied from the first.
fn compress(
    image: &dyn Source,
    index: BlockIndex,
    headers: &[Header],
    gap: &OnceLock<(Chunk, Hash)>,
) -> Result<(Chunk, Hash), Error> {
    let window = window(index);
    let is_gap = window.area() == TILE * TILE && image.sampled(window)[1];
    if let (true, Some((chunk, hash))) = (is_gap, gap.get()) {
        let mut chunk = chunk.clone();
        if let CompressedBlock::Tile(tile) = &mut chunk.compressed_block {
            let place = index.pixel_position / Vec2(TILE, TILE);
            tile.coordinates.tile_index = place;
        }
        return Ok((chunk, *hash));
    }
    let bits = bits(&image.part(window));
    let data = cast_slice(&bits).to_vec();
    let block = UncompressedBlock { index, data };
    let new = (block.compress_to_chunk(headers)?, hash(&bits));
    if is_gap {
        let _ = gap.set(new.clone());
    }
    Ok(new)
}

/// Width and height of a block in pixels.
const TILE: usize = 64;

/// Blocks that are in memory at a time before they are compressed.
const BATCH: usize = 256;

/// The first pixel.
const PIXEL: Window = Window { corner: (0, 0), size: (1, 1) };

/// The window of a block.
fn window(block: BlockIndex) -> Window {
    let [corner, size] = [block.pixel_position, block.pixel_size];
    let pair = |Vec2(x, y)| (x as u32, y as u32);
    Window { corner: pair(corner), size: pair(size) }
}

/// What stands before the blocks.
fn header(image: &dyn Source) -> Header {
    let (width, height) = image.size();
    let pixel = image.part(PIXEL);
    let channels = channels(&pixel).into_iter();
    let channels = channels
        .map(|(name, kind, _)| ChannelDescription::named(name, kind));
    let tiles = BlockDescription::Tiles(TileDescription {
        tile_size: Vec2(TILE, TILE),
        level_mode: LevelMode::Singular,
        rounding_mode: RoundingMode::Down,
    });
    let checksum = (&CHECKSUM.to_owned(), &"0".repeat(64));
    let all = image.attributes().iter().chain([checksum]);
    let other = all.map(attribute).collect();
    let layer = LayerAttributes { other, ..LayerAttributes::default() };
    let size = Vec2(width as usize, height as usize);
    Header::new(Text::default(), size, channels.collect())
        .with_encoding(Compression::ZIP16, tiles, LineOrder::Increasing)
        .with_attributes(layer)
}

/// The channels that the image fills, by name.
fn channels(image: &Image) -> Vec<(&'static str, SampleType, &[f64])> {
    let Image { means, errors, samples, tile_errors, .. } = image;
    let all = [
        (MEAN, SampleType::F32, Some(means)),
        (SAMPLES, SampleType::U32, samples.as_ref()),
        (ERROR, SampleType::F32, errors.as_ref()),
        (SHARED, SampleType::F32, tile_errors.as_ref()),
    ];
    let all = all.into_iter();
    all.filter_map(|(name, kind, v)| Some((name, kind, &v?[..]))).collect()
}

/// The numbers of a part of an image as they are in a block.
fn bits(part: &Image) -> Vec<u32> {
    let (channels, width) = (channels(part), part.width as usize);
    let mut bits = Vec::with_capacity(channels.len() * part.means.len());
    for first in (0..part.means.len()).step_by(width) {
        for (_, kind, values) in &channels {
            let row = values[first..first + width].iter();
            match kind {
                SampleType::U32 => bits.extend(row.map(|&n| n as u32)),
                _ => bits.extend(row.map(|&x| (x as f32).to_bits())),
            }
        }
    }
    bits
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

/// Sorts the attributes in the header of a file of one part by name, and
/// fills in the checksum.
fn finish_attributes(file: &mut [u8], checksum: &str) {
    let mut rest = &file[8..];
    let mut attributes = Vec::new();
    let name = format!("{PREFIX}{CHECKSUM}\0");
    while let Some(length) = attribute_length(rest) {
        let (attribute, others) = rest.split_at(length);
        let mut attribute = attribute.to_vec();
        if attribute.starts_with(name.as_bytes()) {
            attribute.truncate(length - checksum.len());
            attribute.extend_from_slice(checksum.as_bytes());
        }
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

type Hash = [u8; 32];

/// SHA-256 of all that a file brings back, in hexadecimal digits, given
/// those of its blocks.
fn checksum(image: &dyn Source, blocks: &[Hash]) -> String {
    let mut sum = Sha256::new();
    let (width, height) = image.size();
    sum.update(width.to_le_bytes());
    sum.update(height.to_le_bytes());
    let pixel = image.part(PIXEL);
    channels(&pixel).iter().for_each(|(name, ..)| sum.update(name));
    sum.update(blocks.as_flattened());
    for (name, value) in image.attributes() {
        for text in [name, value] {
            sum.update((text.len() as u64).to_le_bytes());
            sum.update(text);
        }
    }
    let hex = |byte: u8| format!("{byte:02x}");
    sum.finalize().into_iter().map(hex).collect()
}

/// That of the numbers of a block.
fn hash(bits: &[u32]) -> Hash {
    let bytes: Vec<_> =
        bits.iter().map(|word| word.to_le_bytes()).collect();
    Sha256::digest(bytes.as_flattened()).into()
}

/// The checksum of an image in memory.
fn checksum_of(image: &Image) -> String {
    let (columns, rows) = (0..image.width, 0..image.height);
    let corners = rows
        .step_by(TILE)
        .flat_map(|y| columns.clone().step_by(TILE).map(move |x| (x, y)));
    let size = |at: u32, end: u32| (end - at).min(TILE as u32);
    let hashes = Vec::from_iter(corners).into_par_iter().map(|(x, y)| {
        let size = (size(x, image.width), size(y, image.height));
        hash(&bits(&image.part(Window { corner: (x, y), size })))
    });
    checksum(image, &hashes.collect::<Vec<_>>())
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
        Some(stated) => data != display || stated != checksum_of(&image),
        None => !image.attributes.is_empty(),
    };
    if wrong {
        return Err("its checksum is wrong: it is damaged, or another \
                    program or version has written it"
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
