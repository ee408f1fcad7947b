// Tangled from chapters/image.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! OpenEXR: channels `Y`, `stderr.Y`, `samples.Y` and, if pixels share random
//! numbers, `tile_stderr.Y`; and attributes.

use std::collections::BTreeMap;
use std::io::{self, Cursor, Write};
use std::ops::Range;
use std::sync::OnceLock;

use bytemuck::cast_slice;
use exr::block::chunk::{Chunk, CompressedBlock};
use exr::block::writer::ChunksWriter;
use exr::block::{
    BlockIndex, UncompressedBlock, enumerate_ordered_header_block_indices,
};
use exr::math::RoundingMode;
use exr::meta::BlockDescription;
use exr::meta::attribute::LevelMode;
use exr::meta::header::Header;
use exr::prelude::{
    AttributeValue, ChannelDescription, Compression, Error,
    LayerAttributes, LineOrder, MetaData, ReadChannels, ReadLayers, Sample,
    SampleType, Text, TileDescription, Vec2,
};
use flate2::Crc;
use memchr::memmem;
use rayon::prelude::*;

use super::data::{BANDS, FILTERED, Image, Note, OPACITY, Source, room};
use super::levels::{COLOURS, luminance};
use crate::error::Result;
use crate::film::Window;

/// Writes the whole content of the image.
pub fn write(image: &dyn Source, out: &mut dyn Write) -> io::Result<()> {
    let mut file = Cursor::new(vec![]);
    let headers = [header(image)].into_iter().collect();
    exr::block::write(&mut file, headers, true, |meta, writer| {
        let blocks = enumerate_ordered_header_block_indices(&meta.headers);
        // Compress some blocks and write them
        let blank: OnceLock<(Vec<u8>, Chunk)> = OnceLock::new();
        let compress = |&(_, index): &(usize, BlockIndex)| {
            // Compress the block of a part of the image
            let [(x, y), size] = [index.pixel_position, index.pixel_size]
                .map(|Vec2(x, y)| (x as u32, y as u32));
            let (left, top) = image.window().corner;
            let window = Window { corner: (left + x, top + y), size };
            let part = image.part(window, true);
            let is_blank = part.means.iter().all(|mean| mean.is_nan());
            let data = cast_slice(&bits(&part)).to_vec();
            // Repeat a block without a sample
            if let Some((same, chunk)) = blank.get()
                && *same == data
            {
                let mut chunk = chunk.clone();
                if let CompressedBlock::Tile(tile) =
                    &mut chunk.compressed_block
                {
                    let place = index.pixel_position / Vec2(TILE, TILE);
                    tile.coordinates.tile_index = place;
                }
                return Ok(chunk);
            }
            let block = UncompressedBlock { index, data: data.clone() };
            let chunk = block.compress_to_chunk(&meta.headers)?;
            if is_blank {
                let _ = blank.set((data, chunk.clone()));
            }
            Ok::<_, Error>(chunk)
        };
        Vec::from_iter(blocks).chunks(BATCH).try_for_each(|blocks| {
            let chunks: Vec<_> = blocks.par_iter().map(compress).collect();
            let mut chunks = blocks.iter().zip(chunks);
            chunks.try_for_each(|(&(number, _), chunk)| {
                writer.write_chunk(number, chunk?)
            })
        })
    })
    .map_err(io::Error::other)?;
    let mut bytes = file.into_inner();
    seal(&mut bytes);
    out.write_all(&bytes)
}

/// The number of blocks in memory at a time before they are compressed.
const BATCH: usize = 256;

/// Width and height of a block in pixels.
const TILE: usize = 64;

/// The header of the file.
fn header(image: &dyn Source) -> Header {
    let (width, height) = image.window().size;
    let pixel = image.part(Window { size: (1, 1), ..image.window() }, true);
    let channels = pixel
        .channels()
        .map(|(name, kind, _)| ChannelDescription::named(name, kind));
    let tiles = BlockDescription::Tiles(TileDescription {
        tile_size: Vec2(TILE, TILE),
        level_mode: LevelMode::Singular,
        rounding_mode: RoundingMode::Down,
    });
    let sum = (&CHECKSUM.to_owned(), &"0".repeat(8));
    let other = image.attributes().iter().chain([sum]).map(attribute);
    let other = other.collect();
    let layer = LayerAttributes { other, ..LayerAttributes::default() };
    let size = Vec2(width as usize, height as usize);
    Header::new(Text::default(), size, channels.collect())
        .with_encoding(Compression::ZIP16, tiles, LineOrder::Increasing)
        .with_attributes(layer)
}

const MEAN: &str = "Y";
const ERROR: &str = "stderr.Y";
const SAMPLES: &str = "samples.Y";
const SHARED: &str = "tile_stderr.Y";

impl Image {
    /// The channels that it fills: name, type in the file, and numbers.
    pub fn channels(
        &self,
    ) -> impl Iterator<Item = (&'static str, SampleType, &[f64])> {
        let Self { means, errors, samples, tile_errors, .. } = self;
        let means = self.channel(BANDS[0]).is_none().then_some(means);
        let list = [
            (MEAN, SampleType::F32, means),
            (SAMPLES, SampleType::U32, samples.as_ref()),
            (ERROR, SampleType::F32, errors.as_ref()),
            (SHARED, SampleType::F32, tile_errors.as_ref()),
        ];
        let list = list.into_iter();
        let list =
            list.filter_map(|(name, kind, v)| Some((name, kind, v?)));
        let more = self.more.iter();
        let more = more.map(|(name, v)| (*name, SampleType::F32, v));
        let mut channels: Vec<_> = list.chain(more).collect();
        channels.sort_unstable_by_key(|channel| channel.0);
        channels.into_iter().map(|(name, kind, v)| (name, kind, &v[..]))
    }
}

/// The numbers of a part of an image in the order of a block.
fn bits(part: &Image) -> Vec<u32> {
    let (mut bits, width) = (vec![], part.width as usize);
    for first in (0..part.means.len()).step_by(width) {
        for (_, kind, values) in part.channels() {
            // Convert a row of a channel
            let row = values[first..first + width].iter();
            match kind {
                SampleType::U32 => bits.extend(row.map(|&n| n as u32)),
                _ => bits.extend(row.map(|&x| (x as f32).to_bits())),
            }
        }
    }
    bits
}

/// The first letters of the names of our attributes.
const PREFIX: &str = "litpt:";

fn attribute((name, value): (&String, &String)) -> (Text, AttributeValue) {
    let text = |text: &str| Text::from_slice_unchecked(text.as_bytes());
    (text(&format!("{PREFIX}{name}")), AttributeValue::Text(text(value)))
}

/// Sorts the attributes in the header of a file of one part by name, and
/// sets the checksum.
fn seal(file: &mut [u8]) {
    let (mut attributes, mut end) = (vec![], 8);
    while file[end] != 0 {
        let texts = file[end..].split_inclusive(|&byte| byte == 0).take(2);
        let size_at = end + texts.map(<[u8]>::len).sum::<usize>();
        let size = file[size_at..]
            .first_chunk()
            .map_or(0, |size| u32::from_le_bytes(*size) as usize);
        attributes.push(file[end..size_at + 4 + size].to_vec());
        end = size_at + 4 + size;
    }
    attributes.sort();
    file[8..end].copy_from_slice(&attributes.concat());
    if let Some((place, sum)) = checksum(file) {
        file[place].copy_from_slice(sum.as_bytes());
    }
}

/// The attribute that holds the checksum.
const CHECKSUM: &str = "checksum";

/// The place of the checksum in a file, and the CRC-32 of all else in
/// hexadecimal digits.
fn checksum(file: &[u8]) -> Option<(Range<usize>, String)> {
    let before = format!("{PREFIX}{CHECKSUM}\0string\0\x08\0\0\0");
    let start = memmem::find(file, before.as_bytes())? + before.len();
    let end = start + 8;
    let mut sum = Crc::new();
    sum.update(&file[..start]);
    sum.update(file.get(end..)?);
    Some((start..end, format!("{:08x}", sum.sum())))
}

/// Reads the first layer of a file that has the channel `Y` or colours;
/// `bytes` is the whole file. `note` receives colours, windows that differ,
/// and a wrong checksum.
///
/// # Errors
/// The file is damaged, or it has neither in full size.
pub fn read(bytes: &[u8], note: Note) -> Result<Image> {
    check_size(bytes)?;
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
    let channels = &layer.channel_data.list;
    let pixels = 0..display.size.area();
    let values = |name: &str| -> Option<Vec<f64>> {
        let channel =
            channels.iter().find(|channel| channel.name.eq(name))?;
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
        let [r, g, b] = BANDS.map(values);
        let colours = [r?, g?, b?];
        let pixel = |i| luminance(&[0, 1, 2].map(|k: usize| colours[k][i]));
        note(COLOURS);
        Some(pixels.clone().map(pixel).collect())
    };
    let means = values(MEAN).or_else(coloured).ok_or_else(|| {
        let names = channels.iter().map(|channel| channel.name.to_string());
        let names = Vec::from_iter(names).join(", ");
        format!("it has neither a channel Y nor R, G and B, but {names}")
    })?;
    let more = [OPACITY, FILTERED[0], FILTERED[1]].into_iter();
    let more = more.filter_map(|name| Some((name, values(name)?)));
    Ok(Image {
        width: display.size.0 as u32,
        height: display.size.1 as u32,
        means,
        errors: values(ERROR),
        samples: values(SAMPLES),
        tile_errors: values(SHARED),
        more: more.collect(),
        attributes: attributes(&layer.attributes, bytes, note),
    })
}

/// Refuses a header that promises more pixels than the file can hold.
fn check_size(bytes: &[u8]) -> Result<()> {
    let meta = MetaData::read_from_buffered(bytes, false)
        .map_err(|error| error.to_string())?;
    for header in &meta.headers {
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
                )
                .into());
            }
        }
    }
    Ok(())
}

/// Our attributes among those of a layer; `note` receives a wrong checksum.
fn attributes(
    layer: &LayerAttributes,
    bytes: &[u8],
    note: Note,
) -> BTreeMap<String, String> {
    let text =
        |text: &Text| String::from_utf8_lossy(text.as_slice()).into_owned();
    let ours = |(name, value): (&Text, &AttributeValue)| {
        let AttributeValue::Text(value) = value else { return None };
        Some((text(name).strip_prefix(PREFIX)?.to_owned(), text(value)))
    };
    let attributes = layer.other.iter().filter_map(ours);
    let mut attributes: BTreeMap<_, _> = attributes.collect();
    // Warn of a checksum that is wrong
    let stated = attributes.remove(CHECKSUM);
    let sum = checksum(bytes).map(|(_, sum)| sum);
    let lost = stated.is_none() && !attributes.is_empty();
    if stated != sum || lost {
        note(
            "its checksum is wrong: it was changed after pt wrote it, by \
             damage or by another program or version",
        );
    }
    attributes
}
