// Tangled from chapters/training.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Renders a film by gathering.
//!
//! Its bits belong to `GATHER_VERSION`.

use std::sync::Arc;

use rayon::prelude::*;

use super::cache::{Grid, RadianceCache};
use super::training::{PILOT_SAMPLES, allocate, pilot, train};
use super::{Allocation, Gather, Learnt, TileSamples, Tracer};
use crate::bvh::{Dispatch, Intersector};
use crate::film::{Film, FilmTile, Watch, add_samples};
use crate::integrator::Renderer;
use crate::sampler::split_mix;

impl Renderer for Gather<'_> {
    fn learn(&mut self, film: &mut Film, watch: &Watch) -> u64 {
        let lacks_pilot = self.correction.is_some() && film.takes_pilot();
        if let Some(learnt) = self.learnt.get()
            && (!lacks_pilot || film.add_pilot(&learnt.pilot))
        {
            return 0;
        }
        let learn = Learn { gather: self, film, watch };
        let found = self.intersector.dispatch(learn);
        self.communicator.all_gather(&[], watch);
        let Some((learnt, rays)) = found else { return 0 };
        if lacks_pilot {
            film.add_pilot(&learnt.pilot);
        }
        let _ = self.learnt.set(learnt);
        rays
    }

    fn training_rays(&self, area: u64) -> u64 {
        let pilot =
            if self.correction.is_some() { PILOT_SAMPLES } else { 0 };
        let rays = self.training + area.saturating_mul(2 * pilot);
        if self.learnt.get().is_some() { 0 } else { rays }
    }

    fn pass(&mut self, film: &mut Film, end: u64, watch: &Watch) -> u64 {
        let is_alone = || self.communicator.rank_and_size().1 == 1;
        assert!(self.learnt.get().is_some() || is_alone(), "unlearnt");
        let rays = match self.learnt.get() {
            None => self.learn(film, &|_| watch(0)),
            Some(_) => 0,
        };
        let Some(learnt) = self.learnt.get() else { return rays };
        let pass = Pass { gather: self, learnt, film, end, watch };
        rays + self.intersector.dispatch(pass)
    }
}

/// Learning that waits for its intersector.
struct Learn<'a> {
    gather: &'a Gather<'a>,
    film: &'a Film,
    watch: &'a Watch<'a>,
}

impl Dispatch for Learn<'_> {
    type Output = Option<(Learnt, u64)>;

    fn with<K: Intersector>(self, intersector: &K) -> Self::Output {
        let Self { gather, film, watch } = self;
        let seed = split_mix(gather.seed);
        let cache = &RadianceCache::empty(Grid::around(&[]));
        let (correction, learnt) = (None, Arc::default());
        let gather = &Gather { seed, correction, learnt, ..*gather };
        let allocation = &Allocation::even(film.run_window, 1);
        let prototype = Tracer::new(gather, intersector, cache, allocation);
        // Train a cache, and another for a glance
        let known = self.gather.learnt.get();
        let (cache, rays) = match known {
            Some(known) => (known.cache.clone(), 0),
            None => shared(train(&prototype, watch)?),
        };
        let (twin, more) = match self.gather.correction {
            Some(_) => (None, 0),
            None => {
                let seed = split_mix(seed);
                let gather =
                    &Gather { seed, learnt: Arc::default(), ..*gather };
                let prototype = Tracer { gather, ..prototype };
                let (twin, rays) = shared(train(&prototype, watch)?);
                (Some(twin), rays)
            }
        };
        let rays = rays + more;
        let prototype = Tracer { cache: &cache, ..prototype };
        // Run a pilot, if there are corrections
        let (allocation, pilot, traced) = match self.gather.correction {
            None => {
                let allocation =
                    Allocation::even(film.run_window, film.net_size);
                (allocation, vec![], 0)
            }
            Some(_) => {
                let found =
                    pilot(&prototype, film, known.is_some(), watch)?;
                let allocation = match known {
                    Some(known) => known.allocation.clone(),
                    None => {
                        allocate(&prototype, film, &found.pixels, watch)?
                    }
                };
                (allocation, found.gathered, found.rays)
            }
        };
        let learnt = Learnt { cache, allocation, twin, pilot };
        watch(0).then_some((learnt, rays + traced))
    }
}

/// What was learnt, to be shared.
fn shared<T>((learnt, rays): (T, u64)) -> (Arc<T>, u64) {
    (learnt.into(), rays)
}

/// A pass that waits for its intersector.
struct Pass<'a> {
    gather: &'a Gather<'a>,
    learnt: &'a Learnt,
    film: &'a mut Film,
    end: u64,
    watch: &'a Watch<'a>,
}

impl Dispatch for Pass<'_> {
    type Output = u64;

    fn with<K: Intersector>(self, intersector: &K) -> u64 {
        let Self { gather, learnt, film, end, watch } = self;
        let Learnt { cache, allocation, twin, .. } = learnt;
        let prototype = Tracer::new(gather, intersector, cache, allocation);
        let net_size = film.net_size;
        let first = film.sample_offset / net_size;
        let end = end.div_ceil(net_size);
        // Render a tile and count its rays
        let render = |part: FilmTile| {
            let FilmTile {
                tile, pixels, mut mean, halves, fragments, ..
            } = part;
            let mut tracer = Tracer { fragments, ..prototype };
            for scramble in pixels[0].count()..end {
                if !watch(0) {
                    break;
                }
                let number = first + scramble;
                if let Some(twin) = twin {
                    tracer.cache =
                        if number % 2 == 1 { twin } else { cache };
                }
                let TileSamples { means: values, sorted, .. } =
                    tracer.tile(tile, number);
                add_samples(halves, number, &sorted);
                let tile_mean =
                    values.iter().sum::<f64>() / values.len() as f64;
                mean.iter_mut().for_each(|mean| mean.add(tile_mean));
                pixels.iter_mut().zip(values).for_each(|(p, v)| p.add(v));
                watch(net_size * pixels.len() as u64);
            }
            tracer.rays
        };
        let tiles = film.tiles().into_par_iter();
        tiles.with_max_len(1).map(render).sum()
    }
}
