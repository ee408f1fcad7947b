// Tangled from chapters/compare.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Pictures for the eye.

use serde::{Deserialize, Serialize};

use super::{Blocks, Difference};
use crate::error::{Error, Result};
use crate::image::levels::radiance;
use crate::image::{BANDS, FILTERED, Image, OPACITY, luminance};
use crate::sky::Sky;

/// How radiances brighter than white are treated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum Curve {
    /// Cut off what is brighter than white
    Clamp,
    /// Bend the scale so that the brightest pixel is white (Reinhard et
    /// al. 2002)
    Reinhard,
}

/// The image as a screen shows it, brighter by `exposure` stops, with its
/// other channels.
pub fn tonemap(image: &Image, exposure: f64, curve: Curve) -> Image {
    let scale = libm::exp2(exposure);
    let outside = image.samples.is_none();
    let expose = |&mean: &f64| match mean.is_nan() && outside {
        true => 0.,
        false => (mean * scale).clamp(0., f64::INFINITY),
    };
    let mut means: Vec<f64> = image.means.iter().map(expose).collect();
    let white = means.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
    // Apply the Reinhard curve
    if curve == Curve::Reinhard {
        for mean in &mut means {
            *mean *= (1. + *mean / white / white) / (1. + *mean);
        }
    }
    let more = image.more.clone();
    Image { more, ..Image::plain(image.width, image.height, means) }
}

/// The image without its background of this radiance, to be laid over
/// another by its opacity.
pub fn cut_out(image: Image, background: f64) -> Image {
    let Some(opacity) = image.channel(OPACITY) else { return image };
    let surface = |(&mean, &a): (&f64, &f64)| match a > 0. {
        true => (mean - (1. - a) * background) / a,
        false => background,
    };
    let means = image.means.iter().zip(opacity).map(surface).collect();
    Image { means, ..image }
}

/// The picture to show of the image in a file.
pub fn picture(image: Image) -> Image {
    let means = image.channel(FILTERED[0]).unwrap_or(&image.means).clone();
    let sky = image.attributes.get("sky");
    let sky: Option<Sky> =
        sky.and_then(|text| serde_json::from_str(text).ok());
    let mut more = image.more;
    more.retain(|(name, _)| *name == OPACITY);
    let ground = image.attributes.get("ground");
    let ground = ground.and_then(|albedo| albedo.parse().ok());
    let background = sky.and_then(|sky| sky.background);
    match background.filter(|&grey| ground != Some(grey)) {
        Some(grey) => cut_out(Image { means, more, ..image }, grey),
        None => Image { means, more: vec![], ..image },
    }
}

/// One image of three bands of the same size, red, green and blue, with
/// their errors and their opacity.
///
/// # Panics
/// There are fewer than three, or one is smaller than the first.
pub fn join(bands: &[Image]) -> Image {
    let mut more = vec![];
    for (i, image) in bands.iter().enumerate() {
        more.push((BANDS[i], image.means.clone()));
        let errors = image.errors.iter().cloned();
        more.extend(errors.map(|errors| (BAND_ERRORS[i], errors)));
    }
    let opacity = bands[0].channel(OPACITY).cloned();
    more.extend(opacity.map(|opacity| (OPACITY, opacity)));
    let pixel = |i| luminance(&[0, 1, 2].map(|k: usize| bands[k].means[i]));
    let means = (0..bands[0].means.len()).map(pixel).collect();
    let mut attributes = bands[0].attributes.clone();
    attributes.retain(|name, value| {
        bands.iter().all(|band| band.attributes.get(name) == Some(value))
    });
    let Image { width, height, .. } = bands[0];
    Image { more, attributes, ..Image::plain(width, height, means) }
}

const BAND_ERRORS: [&str; 3] = ["stderr.R", "stderr.G", "stderr.B"];

/// By how much a picture is brighter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Exposure {
    /// By this number of stops.
    Stops(f64),
    /// By the number of stops that suits its pixels.
    Auto,
}

impl Exposure {
    /// Reads a number of stops, or `auto`.
    ///
    /// # Errors
    /// It is neither.
    pub fn parse(text: &str) -> Result<Self> {
        let stops =
            text.parse().ok().filter(|stops: &f64| stops.is_finite());
        match (text, stops) {
            ("auto", _) => Ok(Self::Auto),
            (_, Some(stops)) => Ok(Self::Stops(stops)),
            _ => {
                let fault = "expected a number of stops, or auto";
                Err(Error::value("exposure", text, fault))
            }
        }
    }

    /// The stops of a picture, given those that suit its pixels.
    pub fn stops(self, auto: impl FnOnce() -> f64) -> f64 {
        if let Self::Stops(stops) = self { stops } else { auto() }
    }
}

/// The attribute of an image that holds the stops which suit its pixels.
pub const AUTO_EXPOSURE: &str = "auto_exposure";

/// The stops that suit a picture, given the radiances of its surfaces.
pub fn auto_stops(mut surfaces: Vec<f64>) -> f64 {
    surfaces.retain(|radiance| radiance.is_finite());
    let n = 99 * surfaces.len() / 100;
    if surfaces.is_empty() {
        return 0.;
    }
    let (_, high, _) = surfaces.select_nth_unstable_by(n, f64::total_cmp);
    let stops = (10. * libm::log2(0.8 / *high)).round() / 10. + 0.;
    if *high > 0. { stops } else { 0. }
}

/// The means of the pixels that seem to show a surface, given the mean and
/// the spread of each; all samples of a uniform sky are 1.
pub fn seeming_surfaces(
    pixels: impl Iterator<Item = (f64, f64)>,
) -> Vec<f64> {
    let seems = |&(mean, spread): &(f64, f64)| spread > 0. && mean < 1.;
    pixels.filter(seems).map(|(mean, _)| mean).collect()
}

/// The standard errors, or their ratio to the means, as grey levels,
/// and the value that is shown as white.
///
/// # Errors
/// The image has no errors, or none is known.
pub fn errors(image: &Image, relative: bool) -> Result<(Image, f64)> {
    let errors = image.errors.as_ref();
    let errors = errors.ok_or("it has no channel stderr.Y")?;
    // Divide the errors by the means
    let value = |(&error, &mean): (&f64, &f64)| match (relative, error) {
        (true, error) if error > 0. => error / mean.abs(),
        _ => error,
    };
    let values = errors.iter().zip(&image.means).map(value);
    let values: Vec<f64> = values.collect();
    // Find the value to show as white
    let mut finite = values.clone();
    finite.retain(|value| value.is_finite());
    finite.sort_by(f64::total_cmp);
    let last = finite.len().checked_sub(1).ok_or("no error is known")?;
    let white = finite[(last as f64 * 0.999).ceil() as usize];
    let grey = |value: f64| value / white.max(f64::MIN_POSITIVE);
    let means = values.into_iter().map(|v| grey(v).min(1.)).collect();
    Ok((Image::plain(image.width, image.height, means), white))
}

/// The image, averaged over squares if a side is longer than `most`
/// pixels; an error is the root of the mean square of its square.
pub fn shrink(image: &Image, most: u32) -> Image {
    let side = image.width.max(image.height).div_ceil(most);
    let squares = Blocks::new(image, (0, 0), side);
    // Average over the squares
    let averages = |values: &mut dyn Iterator<Item = f64>| -> Vec<f64> {
        let mut sums = vec![0.; squares.blocks.len()];
        let places = squares.of.iter().map(|&square| square as usize);
        places.zip(values).for_each(|(at, value)| sums[at] += value);
        let areas = squares.blocks.iter().map(|&(_, area)| area);
        sums.iter().zip(areas).map(|(s, n)| s / f64::from(n)).collect()
    };
    let errors = image.errors.as_ref().map(|errors| {
        let squares = averages(&mut errors.iter().map(|e| e * e));
        squares.into_iter().map(f64::sqrt).collect()
    });
    let means = averages(&mut image.means.iter().copied());
    let [width, height] =
        [image.width, image.height].map(|n| n.div_ceil(side));
    Image { errors, ..Image::plain(width, height, means) }
}

/// The number of standard errors that are shown as white.
pub const WHITE: f64 = 5.;

/// The z of each pixel, as numbers or as grey levels.
pub fn z_map(image: &Image, difference: &Difference, grey: bool) -> Image {
    let largest = f64::from(f32::MAX);
    let means = difference.z.iter().map(|&z| match grey {
        true => radiance((0.5 + z / (2. * WHITE)).clamp(0., 1.)),
        false => z.clamp(-largest, largest),
    });
    Image::plain(image.width, image.height, means.collect())
}
