// Says whether two images of `pt` agree within their errors:
// cargo run --release --example agree -- A.exr B.exr
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use std::error::Error;
use std::path::Path;

use litpt::compare::compare;
use litpt::image::Image;

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<_> = std::env::args().skip(1).collect();
    let [a, b] = &words[..] else {
        return Err("usage: agree A.exr B.exr".into());
    };
    let [a, b] = [a, b].map(|path| Image::read(Path::new(path)));
    let difference = compare(&a?, &b?)?;
    let z = difference.sum.z();
    println!("the means are {z:+.1} standard errors apart");
    let verdict = if difference.consistent() { "agree" } else { "differ" };
    println!("the images {verdict}");
    Ok(())
}
