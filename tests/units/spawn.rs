// Points beside a triangle (chapter "Where the next ray starts").
//
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

use glam::DVec3;

use super::is_beside;

#[test]
fn a_triangle_seen_edge_on_separates_from_no_point_near_it() {
    // Two corners coincide, as where an edge is parallel to the ray.
    let flat = [DVec3::ZERO, DVec3::ZERO, DVec3::Y];
    let point = DVec3::new(-0.125, 0.25, 0.);
    for normal in [DVec3::Z, -DVec3::Z] {
        assert!(!is_beside(flat, normal, point, 0.25));
        assert!(is_beside(flat, normal, point, 0.0625));
    }
}
