// Tangled from chapters/program.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The files of a run: those that it will write, none of them touched yet,
//! and the reference image.

use std::path::{Path, PathBuf};

use super::progress;
use crate::compare::disagreements;
use crate::error::{Error, Result};
use crate::image::Image;
use crate::output::{OutputTarget, refuse_aliases};
use crate::plan::{Outputs, Plan, Product, is_dash};
use crate::run_output::attributes;
use crate::sky::Cover;
use crate::world::World;

/// The files that a run will write.
///
/// # Errors
/// A file is named twice, or cannot be written.
pub fn open(plan: &Plan) -> Result<Vec<(Product, OutputTarget)>> {
    let Outputs { files, force, replaced, .. } = &plan.outputs;
    let (scene, points) = (&*plan.scene, plan.points());
    let sky = match &plan.sky.cover {
        Cover::Matrix(file, _) => Some(&**file),
        _ => None,
    };
    let reference = plan.reference.as_deref();
    let others = [reference, points];
    if is_dash(scene) && others.into_iter().flatten().any(is_dash) {
        return Err("standard input can be read once only".into());
    }
    let cache = plan.cache.as_deref();
    let read = [Some(scene), reference, cache, points, sky];
    let written = files.iter().map(|(_, path)| path.as_path());
    refuse_aliases(read.into_iter().flatten(), written)?;
    // Open what is new, or may be replaced
    let may_replace = |path: &Path| {
        let old = replaced.iter().map(|old| old.canonicalize());
        let is_own = |new| old.flatten().any(|old| old == new);
        *force || path.canonicalize().is_ok_and(is_own)
    };
    let open = |(product, path): &(Product, PathBuf)| {
        Ok((*product, OutputTarget::file(path, may_replace(path))?))
    };
    files.iter().map(open).collect()
}

/// The reference image of a plan, if there is one.
///
/// # Errors
/// It cannot be read whole, or has another size than ours.
pub fn reference(plan: &Plan) -> Result<Option<Image>> {
    let (Some(path), Some(camera)) = (&plan.reference, plan.camera())
    else {
        return Ok(None);
    };
    // Read an image that needs no note
    let mut faults = Vec::new();
    let note = &mut |fault: &str| faults.push(fault.to_owned());
    let image = Image::read_noting(path, note)?;
    if let Some(fault) = faults.first() {
        let fault = format!(
            "{fault}; a reference needs the radiance of each pixel"
        );
        return Err(fault.into());
    }
    let (w, h) = camera.window().size;
    let Image { width, height, .. } = image;
    if (width, height) != (w, h) {
        let fault = format!(
            "is {width}x{height} pixels large, and the image {w}x{h}"
        );
        return Err(Error::from(fault).of_file(path));
    }
    // Warn of a reference with our seed
    if image.attributes.get("seed") == Some(&plan.seed.to_string()) {
        progress::warn(
            "the reference has the seed of this run: its true errors are \
             larger than they will seem (choose another seed with -s)",
        );
    }
    Ok(Some(image))
}

/// Refuses a reference that shows something else than a world.
///
/// # Errors
/// It does; the differences are named.
pub fn check_reference(
    plan: &Plan,
    reference: Option<&Image>,
    world: &World,
) -> Result<()> {
    let (Some(image), Some(path)) = (reference, &plan.reference) else {
        return Ok(());
    };
    let mut ours = attributes(&world.subject);
    ours.insert("scene_sha256".into(), world.report.scene.sha256.clone());
    let differing = disagreements(&image.attributes, &ours).join(", ");
    if differing.is_empty() {
        return Ok(());
    }
    let fault = format!("shows something else than this run: {differing}");
    Err(Error::from(fault).of_file(path))
}

/// Keeps the place of a standard output that is closed.
pub extern "C" fn keep_the_place() {
    // SAFETY: the calls take numbers and a constant text.
    let closed = || unsafe { libc::fcntl(1, libc::F_GETFD) } < 0;
    let null = c"/dev/null".as_ptr();
    // The first free number may be standard input's.
    while closed() && unsafe { libc::open(null, libc::O_RDONLY) } >= 0 {}
}
