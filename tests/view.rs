// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Several views of one scene, as a program shows that turns it.

use crate::prelude::*;

use std::ffi::OsString;

use litpt::cli::options::Options;

fn plan(scene: &Path, words: &str) -> Plan {
    let words = format!("pt -d9x7 -n2 --integrator=reference {words}");
    let words = words.split_whitespace().map(OsString::from);
    let options = Options::parse(words.chain([scene.into()])).unwrap();
    options.plan(None, false).unwrap()
}

#[test]
fn a_scene_that_is_shown_in_another_way_is_as_if_read_for_it() {
    let floor = "g floor\nf 1 2 3 4\ng walls\n";
    let place =
        Scratch::with("room.obj", ROOM.replace("f 1 2 3 4\n", floor));
    let scene = &place.path("room.obj");
    let all = [
        "-r 0.5",
        "-r 0.5 --ground 0.3",
        "-r 0.5 --ground 0.3 --zenith 1,0,0.2",
        "-r 0.7 -r floor=0.2 -p 3,1,2 -t 0,0,0",
        "-r 0.7 -r floor=0.2 --view top --sky overcast",
        "-d 8x8 -r 0.7 -F 30 -u y",
    ];
    let open = |mut plan: Plan| {
        let inputs = Inputs::read(&plan, Host::default()).unwrap();
        let mesh = inputs.mesh.clone();
        plan.look_up(&mesh);
        (mesh, World::new(&plan, inputs, Host::default()).unwrap())
    };
    let (mesh, mut world) = open(plan(scene, all[0]));
    let mut images = vec![];
    for words in all.into_iter().chain(all) {
        let mut now = plan(scene, words);
        now.look_up(&mesh);
        world.show(&now, &mesh).unwrap();
        let (_, fresh) = open(now.clone());
        assert!(world.subject == fresh.subject, "{words}");
        let image = |world: &World| values_of(world, &now);
        let shown = image(&world);
        assert_eq!(shown, image(&fresh), "{words}");
        // What is refused changes nothing.
        let refused = plan(scene, "-r nothing=0.2 --ground 0.9 -p 9,9,9");
        assert!(world.show(&refused, &mesh).is_err());
        assert_eq!(shown, image(&world), "{words}");
        images.push(shown);
    }
    // Each of the ways shows something else.
    images.truncate(all.len());
    for (i, one) in images.iter().enumerate() {
        assert!(one.iter().any(|[mean, _]| *mean > 0.), "{}", all[i]);
        assert!(!images[..i].contains(one), "{}", all[i]);
    }
}
