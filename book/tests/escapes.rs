// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! A path that has got through a wall is noticed.

use glam::DVec3;
use litpt::bvh::{Bvh, Dispatch, Intersector};
use litpt_book::escapes::Path;
use litpt_book::solids::{self, Solid};
use rand::SeedableRng;
use rand_pcg::Pcg64Mcg;

struct Within<'a>(&'a Solid, DVec3);

impl Dispatch for Within<'_> {
    type Output = bool;

    fn with<K: Intersector>(self, intersector: &K) -> bool {
        let mut random = Pcg64Mcg::seed_from_u64(1);
        let mut path = Path::new(self.1, DVec3::new(0.6, 0., -0.8));
        path.is_within(&self.0.own(), intersector, &mut random)
    }
}

#[test]
fn a_path_that_has_got_inside_is_told_from_one_outside() {
    for solid in &solids::all() {
        let bvh = Bvh::new(&solid.scene).unwrap();
        let inside = solid.cameras[0];
        assert!(bvh.dispatch(Within(solid, inside)), "{}", solid.name);
        let above = inside + DVec3::new(-6e4, 0., 8e4);
        assert!(!bvh.dispatch(Within(solid, above)), "{}", solid.name);
    }
}
