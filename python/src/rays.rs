// Tangled from chapters/python.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! First hits of many rays.

use std::array;

use glam::DVec3;
use litpt::bvh::{BEAM, Batch, Bvh, Dispatch, GROUND, Intersector};
use litpt::host::Host;
use litpt::numerics::normalise;
use litpt::plan::{Budget, CameraPlan, Plan, SensorPlan, Stand};
use litpt::scene::{Frame, Ray};
use litpt::world::Geometry;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use rayon::prelude::*;

use crate::{SceneData, mesh::vectors, on_threads};

/// The number of the face of each ray, or -1, and the place of its hit.
pub type Hits<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray2<f64>>);

/// Traces rays through a scene.
struct Trace<'a> {
    bvh: &'a Bvh,
    frame: &'a Frame,
    rays: &'a [(DVec3, DVec3)],
}

impl Dispatch for Trace<'_> {
    type Output = Vec<(i64, [f64; 3])>;

    fn with<K: Intersector>(self, intersector: &K) -> Self::Output {
        // Trace batches of rays
        let Self { bvh, frame, rays } = self;
        let hits = |rays: &[(DVec3, DVec3)]| {
            let ray = |&(origin, direction): &(DVec3, DVec3)| {
                let direction = normalise(direction).normalize();
                frame.entrance(origin).enter(direction)
            };
            let batch: Batch<Ray> =
                array::from_fn(|i| rays.get(i).and_then(ray));
            let hits = intersector.first_hits(&batch);
            let found = hits.map(|hit| match hit {
                Some(hit) if hit.primitive < GROUND => {
                    let face = bvh.face(hit.primitive).into();
                    (face, frame.back(hit.point).to_array())
                }
                _ => (-1, [f64::NAN; 3]),
            });
            found.into_iter().take(rays.len())
        };
        rays.par_chunks(BEAM).flat_map_iter(hits).collect()
    }
}

/// The first hits of rays; between parts of them signals are answered.
pub fn hits<'py>(
    py: Python<'py>,
    scene: &SceneData,
    mut plan: Plan,
    origins: &PyReadonlyArray2<f64>,
    directions: &PyReadonlyArray2<f64>,
) -> PyResult<Hits<'py>> {
    let (from, to) = (vectors(origins), vectors(directions));
    let rays: Vec<_> = from.into_iter().zip(to).collect();
    // Prepare a world of one pixel with as many samples as there are rays
    let stand = Stand::At(DVec3::ZERO, DVec3::Y);
    let camera =
        CameraPlan { resolution: (1, 1), stand, ..CameraPlan::default() };
    plan.sensor = SensorPlan::Camera(camera);
    plan.budget = Budget::samples(rays.len().max(1) as u64);
    let (mut faces, mut places) = (vec![], vec![]);
    for rays in rays.chunks(1 << 20) {
        let trace = || {
            let inputs = scene.inputs.clone();
            let world = scene.world(&plan, inputs, Host::default())?;
            let Geometry { bvh, frame, .. } = &*world.geometry;
            Ok(bvh.dispatch(Trace { bvh, frame, rays }))
        };
        let found = py.detach(|| on_threads(plan.threads, trace))?;
        let (some_faces, some_places): (Vec<_>, Vec<_>) =
            found.into_iter().unzip();
        faces.extend(some_faces);
        places.extend(some_places.into_flattened());
        py.check_signals()?;
    }
    let places = PyArray1::from_vec(py, places).reshape([rays.len(), 3])?;
    Ok((PyArray1::from_vec(py, faces), places))
}
