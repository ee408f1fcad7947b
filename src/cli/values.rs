// Tangled from chapters/options.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The values of options: how they are parsed, and why they are refused.

use std::num::{IntErrorKind, ParseIntError};
use std::str::FromStr;

use clap::ValueEnum;
use glam::DVec3;

use crate::camera::Viewpoint;
use crate::film::digits;
use crate::materials::glass::Bsdf;
use crate::render::choose::Method;
use crate::sky::{Sun, parse_pair};

/// Parses a finite real number.
pub fn parse_real(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(real) if real.is_finite() => Ok(real),
        Ok(_) => Err(format!("{text} is not a finite number")),
        Err(_) => Err(format!("'{text}' is not a real number")),
    }
}

pub fn parse_vector(text: &str) -> Result<DVec3, String> {
    let parts = text.split(',').map(|part| parse_real(part.trim()));
    match parts.collect::<Result<Vec<_>, _>>()?[..] {
        [x, y, z] => Ok(DVec3::new(x, y, z)),
        _ => Err("expected three reals around two commas".to_owned()),
    }
}

/// Parses a vector or the name of an axis.
pub fn parse_direction(text: &str) -> Result<DVec3, String> {
    match text {
        "x" => Ok(DVec3::X),
        "y" => Ok(DVec3::Y),
        "z" => Ok(DVec3::Z),
        _ => match parse_vector(text)? {
            DVec3::ZERO => Err("a direction is not zero".to_owned()),
            vector => Ok(vector),
        },
    }
}

/// Parses the direction to the sun.
pub fn parse_sun(text: &str) -> Result<Sun, String> {
    let wanted = "expected X,Y,Z or AZIMUTH,ALTITUDE, an altitude above 0, up \
                  to 90";
    match parse_pair(text) {
        Some([azimuth, altitude]) if altitude > 0. && altitude <= 90. => {
            Ok(Sun::At(azimuth, altitude))
        }
        Some(_) => Err(wanted.to_owned()),
        None => parse_direction(text)
            .map(Sun::Toward)
            .map_err(|_| wanted.to_owned()),
    }
}

/// The requested method; none if a pilot is to choose one. `clap` would
/// take a bare `Option` for an option that may be left out.
pub type RequestedMethod = Option<Method>;

/// Parses the name of a method, or `auto`.
pub fn parse_method(name: &str) -> Result<RequestedMethod, String> {
    let mut methods = Method::ALL.into_iter();
    match methods.find(|method| method.to_string() == name) {
        None if name != "auto" => {
            Err("expected auto, reference, sobol or gather".to_owned())
        }
        method => Ok(method),
    }
}

/// Parses a target error, and whether it is relative.
pub fn parse_target(text: &str) -> Result<(f64, bool), String> {
    if ["rms", "max"].contains(&text) {
        return Err(format!(
            "expected a number; --error-norm {text} is what \
             it limits"
        ));
    }
    let positive = only(parse_real, |&x| x > 0., POSITIVE);
    let part = text.strip_suffix('%');
    let unit = if part.is_some() { 0.01 } else { 1. };
    let error = unit * positive(part.unwrap_or(text))?;
    Ok((error, part.is_some()))
}

/// Parses an albedo, which may be a percentage.
pub fn parse_albedo(text: &str) -> Result<f64, String> {
    only(parse_share, |x| (0. ..=1.).contains(x), ALBEDO)(text)
}

/// Parses a part of a whole: a number, or a percentage.
pub fn parse_share(text: &str) -> Result<f64, String> {
    match text.strip_suffix('%') {
        Some(percent) => Ok(parse_real(percent.trim_end())? / 100.),
        None => parse_real(text),
    }
}

/// Parses an albedo after the name it belongs to, which may be empty.
pub fn parse_named_albedo(text: &str) -> Result<(String, f64), String> {
    let (name, albedo) = text.rsplit_once('=').unwrap_or(("", text));
    Ok((name.to_owned(), parse_albedo(albedo)?))
}

/// Parses the transmittance of what is named, or `materials`.
pub fn parse_glass(text: &str) -> Result<(String, Option<f64>), String> {
    match text.rsplit_once('=') {
        Some((name, part)) if !name.is_empty() => {
            Ok((name.to_owned(), Some(parse_share(part)?)))
        }
        None if text == "materials" => Ok((String::new(), None)),
        _ => Err("expected NAME=TAU, or materials".to_owned()),
    }
}

/// Parses the parts that what is named reflects and transmits.
pub fn parse_transmitter(text: &str) -> Result<(String, Bsdf), String> {
    let parts = text.rsplit_once('=').filter(|(name, _)| !name.is_empty());
    let wanted = || "expected NAME=RHO,TAU".to_owned();
    let (name, parts) = parts.ok_or_else(wanted)?;
    let (back, on) = parts.split_once(',').ok_or_else(wanted)?;
    let [back, on] = [back, on].map(|part| parse_share(part.trim()));
    Ok((name.to_owned(), Bsdf::Transmitter([back?, on?])))
}

/// A parser of valid values; `expected` describes them in words.
pub fn only<T>(
    parse: fn(&str) -> Result<T, String>,
    is_valid: fn(&T) -> bool,
    expected: &'static str,
) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| match parse(text)? {
        value if is_valid(&value) => Ok(value),
        _ => Err(expected.to_owned()),
    }
}

pub const ANGLE: &str = "expected an angle strictly between 0 and 180";

pub const ALBEDO: &str = "expected an albedo between 0 and 1";

pub const GREY: &str = "expected a radiance from 0 to 1e9";

pub const POSITIVE: &str = "expected a number greater than zero";

pub const SAMPLES: &str = "a pixel needs at least one sample";

pub const THREADS: &str = "expected an integer between 1 and 4096";

pub fn parse_whole(text: &str) -> Result<u64, String> {
    digits(text).map_err(|error: ParseIntError| match error.kind() {
        IntErrorKind::PosOverflow => {
            format!("{text} is larger than {}", u64::MAX)
        }
        _ => format!("'{text}' is not a whole number in digits"),
    })
}

/// Two whole numbers around a sign.
pub fn pair<N: FromStr>(text: &str, sign: &str) -> Option<(N, N)> {
    let (a, b) = text.split_once(sign)?;
    Some((digits(a).ok()?, digits(b).ok()?))
}

pub fn parse_range(text: &str) -> Result<(u64, u64), &'static str> {
    pair(text, "..").filter(|(from, to)| from <= to).ok_or(
        "expected two numbers with two dots between, the smaller first, \
         as in 16..32; -n is the number of samples",
    )
}

pub fn parse_band(text: &str) -> Result<(u32, u32), &'static str> {
    pair(text, "/")
        .filter(|&(k, n)| 0 < k && k <= n)
        .ok_or("expected a number from 1 to N, a slash and N, as in 2/8")
}

/// Parses a side, and the degrees by which a camera is turned and raised.
pub fn parse_viewpoint(
    text: &str,
) -> Result<(Viewpoint, [f64; 2]), String> {
    let (name, angles) = text.split_once(',').unwrap_or((text, "0"));
    let side = Viewpoint::from_str(name, false);
    let side = side.map_err(|_| format!("'{name}' is none of {SIDES}"))?;
    let (turn, rise) = angles.split_once(',').unwrap_or((angles, "0"));
    let [turn, rise] = [parse_real(turn)?, parse_real(rise)?];
    let own = if side == Viewpoint::Iso { 29. } else { 0. };
    let is_clear = (own + rise).abs() <= 89.;
    is_clear.then_some((side, [turn, rise])).ok_or(RISE.to_owned())
}

const SIDES: &str = "front, back, left, right, top and iso";

const RISE: &str = "a camera is raised or lowered by 89 degrees at most, and \
                    from iso raised by 60";

/// Parses a sample: a pixel and a number.
pub fn parse_sample(text: &str) -> Result<(u32, u32, u64), &'static str> {
    let sample = || {
        let (pixel, n) = text.rsplit_once(',')?;
        let (x, y) = pair(pixel, ",")?;
        Some((x, y, digits(n).ok()?))
    };
    sample().ok_or("expected a column, a row and a number, as in 10,20,0")
}
