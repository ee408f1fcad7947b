// Tangled from chapters/mpi.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command `pt-mpi`: one run on many processes, which send each other
//! messages.
//!
//! Rank 0 leads: it has the film and hands out pieces of each pass. The
//! others follow: they render pieces and send the sums back.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::process::{self, ExitCode};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering::Relaxed};
use std::sync::{Arc, Mutex, MutexGuard, Once, PoisonError, mpsc};
use std::time::{Duration, Instant};
use std::{env, panic, thread};

use litpt::cli::files::keep_the_place;
use litpt::cli::ranks::{Ranks, follow};
use litpt::cli::{progress, run::main_with};
use litpt::error::Result;
use litpt::film::{Film, Fragments, SIDE, Watch, Window};
use litpt::integrator::Communicator;
use litpt::key::RunKey;
use litpt::render::{RankStats, Renderer};
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator as _, *};
use mpi::{Rank, Threading};
use serde::{Deserialize, Serialize};

/// Called when the program is loaded.
#[used]
#[cfg_attr(target_os = "linux", unsafe(link_section = ".init_array"))]
static BEFORE_MAIN: extern "C" fn() = keep_the_place;

/// The processes that MPI has started.
struct World;

impl Communicator for World {
    fn rank_and_size(&self) -> (usize, usize) {
        (world().rank() as usize, world().size() as usize)
    }

    fn all_gather<'a>(
        &self,
        own: &'a [u8],
        watch: &Watch,
    ) -> Cow<'a, [u8]> {
        if world().rank() > 0 {
            report(own);
            return hear().unwrap_or_default().into();
        }
        let look = || {
            watch(0);
            answer()
        };
        let others = (1..self.rank_and_size().1).map(|_| wait_for(look));
        let parts = BTreeMap::from_iter(others.chain([(0, own.to_vec())]));
        let mut whole = Vec::from_iter(parts.into_values()).concat();
        tell(&mut whole);
        whole.into()
    }

    fn broadcast(&self, mut own: Vec<u8>) -> Result<Vec<u8>> {
        if world().rank() == 0 {
            tell(&mut own);
            return Ok(own);
        }
        hear().ok_or_else(|| "rank 0 has ended".into())
    }
}

impl Ranks for World {
    fn lead<'a>(
        &self,
        own: Box<dyn Renderer + 'a>,
        run_key: &'a RunKey,
        shown: Option<Arc<Fragments>>,
    ) -> Box<dyn Renderer + 'a> {
        if self.rank_and_size().1 == 1 {
            return own;
        }
        let own = Worker::new(own, run_key, shown);
        let shares = vec![RankStats::default(); self.rank_and_size().1];
        Box::new(Leader { own, shares, passes: 0., least: 0. })
    }

    fn serve(
        &self,
        renderer: Box<dyn Renderer + '_>,
        run_key: &RunKey,
        shown: Option<Arc<Fragments>>,
    ) {
        let goes_on = |_| !STOPPED.load(Relaxed);
        let mut own = Worker::new(renderer, run_key, shown);
        // Learn with the leader
        if wait_for(pending_order) != Order::Learn {
            return;
        }
        let look = Mutex::new(());
        let mut film = own.with_halves(run_key.film());
        own.renderer.learn(&mut film, &|rays| {
            if let Ok(_guard) = look.try_lock() {
                pending_order();
            }
            goes_on(rays)
        });
        let (pieces, todo) = mpsc::channel();
        let (done, parts) = mpsc::channel::<Vec<u8>>();
        thread::scope(|scope| {
            scope.spawn(move || {
                // Pass orders on and send sums until the end
                loop {
                    match pending_order() {
                        Some(Order::Render(it)) => _ = pieces.send(it),
                        Some(_) => return,
                        None => match parts.try_recv() {
                            Ok(part) => report(&part),
                            Err(_) => thread::sleep(POLL),
                        },
                    }
                }
            });
            for piece in todo {
                let part = own.render(piece, &goes_on);
                let _ = done.send(part.to_bytes());
            }
        });
    }
}

fn main() -> ExitCode {
    let begun = mpi::initialize_with_threading(Threading::Serialized);
    let begun = begun.filter(|(_, given)| *given >= Threading::Serialized);
    let Some(_universe) = begun else {
        progress::error("MPI does not allow for threads");
        return ExitCode::FAILURE;
    };
    abort_on_panic();
    match world().rank() {
        0 => shutdown(main_with(env::args_os().collect(), &World).into()),
        rank => serve(rank),
    }
}

/// Renders for rank 0.
fn serve(rank: Rank) -> ExitCode {
    if let Err(message) = follow(&World)
        && !ENDED.load(Relaxed)
        && wait_for(pending_order) != Order::End
    {
        progress::error(&format!("rank {rank}: {message}"));
        world().abort(1);
    }
    ExitCode::SUCCESS
}

fn abort_on_panic() {
    let report = panic::take_hook();
    panic::set_hook(Box::new(move |what| {
        report(what);
        process::abort();
    }));
}

/// The time that rank 0 waits for answers when it has to stop.
const GRACE: Duration = Duration::from_millis(250);

/// Ends the run of the other ranks.
fn shutdown(status: ExitCode) -> ExitCode {
    for _ in 0..OUTSTANDING.load(Relaxed) {
        wait_for(answer);
    }
    send_all(Order::End);
    status
}

/// An order of rank 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum Order {
    /// Receive so many bytes, which are broadcast.
    Listen(u64),
    /// Learn, with all others.
    Learn,
    /// Render a piece.
    Render(Piece),
    /// Drop the pieces that are not yet rendered.
    Stop,
    /// There is nothing more to do.
    End,
}

/// The time between two looks for a message.
const POLL: Duration = Duration::from_micros(500);

/// The group of all ranks.
fn world() -> SimpleCommunicator {
    SimpleCommunicator::world()
}

/// Looks again and again, until something is found.
fn wait_for<T>(look: impl Fn() -> Option<T>) -> T {
    loop {
        match look() {
            Some(found) => return found,
            None => thread::sleep(POLL),
        }
    }
}

/// Whether rank 0 has given the order to stop.
static STOPPED: AtomicBool = AtomicBool::new(false);

/// Whether rank 0 has nothing more to do.
static ENDED: AtomicBool = AtomicBool::new(false);

/// The next order, if it is there; the order to stop is recorded and not
/// returned.
fn pending_order() -> Option<Order> {
    let found = world().process_at_rank(0).immediate_matched_probe();
    let (text, _) = found?.matched_receive_vec::<u8>();
    let order = serde_json::from_slice(&text).unwrap_or(Order::End);
    STOPPED.fetch_or(order == Order::Stop, Relaxed);
    ENDED.fetch_or(order == Order::End, Relaxed);
    (order != Order::Stop).then_some(order)
}

/// Sends a message to rank 0, and does not keep a core busy meanwhile.
fn report(bytes: &[u8]) {
    let world = world();
    let leader = world.process_at_rank(0);
    mpi::request::scope(|scope| {
        let mut request = leader.immediate_send(scope, bytes);
        while let Err(pending) = request.test() {
            request = pending;
            thread::sleep(POLL / 10);
        }
    });
}

/// Sends an order to one rank.
fn send(rank: Rank, order: Order) {
    let text = serde_json::to_vec(&order).unwrap_or_default();
    world().process_at_rank(rank).send(&text[..]);
}

/// Sends an order to all other ranks.
fn send_all(order: Order) {
    (1..world().size()).for_each(|rank| send(rank, order));
}

/// Broadcasts some bytes to all other ranks.
fn tell(bytes: &mut [u8]) {
    send_all(Order::Listen(bytes.len() as u64));
    broadcast(bytes);
}

/// The bytes that rank 0 broadcasts; none if there is nothing more to do.
fn hear() -> Option<Vec<u8>> {
    let Order::Listen(n) = wait_for(pending_order) else { return None };
    let mut bytes = vec![0; n as usize];
    broadcast(&mut bytes);
    Some(bytes)
}

fn broadcast(bytes: &mut [u8]) {
    let world = world();
    let root = world.process_at_rank(0);
    bytes.chunks_mut(1 << 30).for_each(|part| root.broadcast_into(part));
}

/// A message to rank 0 and its sender, if there is one.
fn answer() -> Option<(usize, Vec<u8>)> {
    let found = world().any_process().immediate_matched_probe()?;
    let (bytes, status) = found.matched_receive_vec::<u8>();
    Some((status.source_rank() as usize, bytes))
}

/// Samples of some tiles that one rank renders.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
struct Piece {
    window: Window,
    /// The samples of each pixel before its own.
    first: u64,
    samples: u64,
}

/// Two windows of whole tiles of this height that make up this one; none
/// if it has a single tile.
fn halves(window: Window, height: u32) -> Option<[Window; 2]> {
    let turn = |Window { corner: (x, y), size: (width, height) }| Window {
        corner: (y, x),
        size: (height, width),
    };
    let bands =
        |w: Window, side| [(1, 2), (2, 2)].map(|band| w.band(band, side));
    let turned = turn(window);
    match (turned.tile_rows(SIDE), window.tile_rows(height)) {
        (1, 1) => None,
        (columns, rows) if columns < rows => Some(bands(window, height)),
        _ => Some(bands(turned, SIDE).map(turn)),
    }
}

/// The first pixel of each tile, of this height, of a window.
fn corners(
    window: Window,
    height: u32,
) -> impl Iterator<Item = (u32, u32)> + Clone {
    let ((left, top), (right, bottom)) = (window.corner, window.end());
    let edges = |from: u32, end: u32, side| {
        let cells = from / side..end.div_ceil(side);
        cells.map(move |k| from.max(k * side))
    };
    let columns = edges(left, right, SIDE);
    let rows = edges(top, bottom, height);
    rows.flat_map(move |y| columns.clone().map(move |x| (x, y)))
}

/// A pass over a film: the windows that no rank has, and the sums that have
/// come back.
struct Pass<'a> {
    film: &'a mut Film,
    /// The samples of each pixel at its end.
    end: u64,
    /// The windows that no rank has; the last one is the next.
    windows: Vec<Window>,
    /// Pixels in all of them.
    left: u64,
    /// The rays of the pieces that have come back.
    rays: u64,
    /// The work of each rank.
    shares: &'a mut [RankStats],
}

impl<'a> Pass<'a> {
    fn new(
        film: &'a mut Film,
        end: u64,
        shares: &'a mut [RankStats],
    ) -> Self {
        let (windows, left) = (vec![film.window], film.area());
        Self { film, end, windows, left, rays: 0, shares }
    }

    /// The largest piece in pixels; it is smaller, the less is left.
    fn most(&self) -> usize {
        let rest = self.left.max(self.film.area() / 16) as usize;
        rest / (4 * self.shares.len())
    }

    /// The next piece, if there is one.
    fn take(&mut self) -> Option<Piece> {
        let most = self.most();
        while let Some(window) = self.windows.pop() {
            // Halve the window if it is too large or its tiles differ
            let height = self.film.tile_height();
            let counts = corners(window, height)
                .map(|(x, y)| self.film.pixel(x, y).count());
            let least = counts.clone().min().unwrap_or_default();
            if (window.area() > most || counts.max() > Some(least))
                && let Some([half, rest]) = halves(window, height)
            {
                self.windows.extend([rest, half]);
                continue;
            }
            let has = least * self.film.net_size;
            self.left -= window.area() as u64;
            let first = self.film.sample_offset + has;
            if let samples @ 1.. = self.end.saturating_sub(has) {
                return Some(Piece { window, first, samples });
            }
        }
        None
    }

    /// Adds what a rank has rendered.
    fn add(&mut self, rank: usize, part: Part) {
        self.film.merge(&part.film);
        self.rays += part.rays;
        self.shares[rank] = part.share;
    }
}

/// The sums of a piece, and the work of its rank so far.
struct Part {
    film: Film,
    /// The rays of this piece.
    rays: u64,
    share: RankStats,
}

impl Part {
    fn to_bytes(&self) -> Vec<u8> {
        let Self { film, rays, share } = self;
        let head = (film.window, film.sample_offset, rays, share);
        let mut bytes = serde_json::to_vec(&head).unwrap_or_default();
        bytes.push(b'\n');
        film.write(&mut bytes).expect("a vector takes all bytes");
        bytes
    }

    fn from_bytes(bytes: &[u8], run_key: &RunKey) -> Option<Self> {
        let end = bytes.iter().position(|&byte| byte == b'\n')?;
        let head = serde_json::from_slice(&bytes[..end]).ok()?;
        let (window, first, rays, share) = head;
        let mut film = run_key.film_of(window, first);
        film.read(&mut &bytes[end + 1..]).ok()?;
        Some(Self { film, rays, share })
    }
}

/// The renderer of the pieces of one rank.
struct Worker<'a> {
    renderer: Box<dyn Renderer + 'a>,
    run_key: &'a RunKey,
    /// What the pixels show, if a picture is to be filtered.
    shown: Option<Arc<Fragments>>,
    /// Its work so far.
    share: RankStats,
    /// The processor time before that.
    before: f64,
}

impl<'a> Worker<'a> {
    fn new(
        renderer: Box<dyn Renderer + 'a>,
        run_key: &'a RunKey,
        shown: Option<Arc<Fragments>>,
    ) -> Self {
        let (before, share) = (processor_seconds(), RankStats::default());
        Self { renderer, run_key, shown, share, before }
    }

    /// The same film, which keeps halves if a picture is to be filtered.
    fn with_halves(&self, film: Film) -> Film {
        match &self.shown {
            Some(shown) => film.with_halves(Some(shown.clone())),
            None => film,
        }
    }

    /// Renders a piece, unless `watch` stops it.
    fn render(&mut self, piece: Piece, watch: &Watch) -> Part {
        let began = Instant::now();
        let film = self.run_key.film_of(piece.window, piece.first);
        let mut film = self.with_halves(film);
        let rays = self.renderer.pass(&mut film, piece.samples, watch);
        let values: u64 = film.pixels.iter().map(|p| p.count()).sum();
        self.share.paths += values * film.net_size;
        self.share.render_seconds += began.elapsed().as_secs_f64();
        self.share.processor_seconds = processor_seconds() - self.before;
        Part { film, rays, share: self.share.clone() }
    }
}

/// A renderer on all ranks.
struct Leader<'a> {
    own: Worker<'a>,
    shares: Vec<RankStats>,
    /// Seconds of all passes.
    passes: f64,
    /// Seconds below which a pass is too short.
    least: f64,
}

impl Renderer for Leader<'_> {
    fn pass(&mut self, film: &mut Film, end: u64, watch: &Watch) -> u64 {
        let (began, own) = (Instant::now(), &mut self.own);
        let run_key = own.run_key;
        let pass = Mutex::new(Pass::new(film, end, &mut self.shares));
        let busy = thread::scope(|scope| {
            let busy = scope.spawn(|| hand_out(&pass, run_key, watch));
            // Render pieces until none is left
            while watch(0) {
                let Some(piece) = locked(&pass).take() else { break };
                let part = own.render(piece, watch);
                locked(&pass).add(0, part);
            }
            busy.join().unwrap_or_default().as_secs_f64()
        });
        let rays = pass.into_inner().map_or(0, |pass| pass.rays);
        // Compute how long each rank has waited
        self.least = 8. * busy;
        self.own.share.collect_seconds += busy;
        self.shares[0] = self.own.share.clone();
        self.passes += began.elapsed().as_secs_f64();
        for share in &mut self.shares {
            share.wait_seconds =
                (self.passes - share.render_seconds).max(0.);
        }
        rays
    }

    fn learn(&mut self, film: &mut Film, watch: &Watch) -> u64 {
        send_all(Order::Learn);
        let stop = Once::new();
        self.own.renderer.learn(film, &|rays| {
            watch(rays) || {
                stop.call_once(|| send_all(Order::Stop));
                false
            }
        })
    }

    fn training_rays(&self, area: u64) -> u64 {
        self.own.renderer.training_rays(area)
    }

    fn shares(&self) -> &[RankStats] {
        &self.shares
    }

    fn least_seconds(&self) -> f64 {
        self.least
    }
}

/// Locks what two threads share, for this thread alone.
fn locked<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Answers that are still to come at the end of a run.
static OUTSTANDING: AtomicUsize = AtomicUsize::new(0);

/// Gives pieces to the other ranks and collects their sums, until all is
/// done or `watch` stops it; returns the time that the sums have taken.
fn hand_out(pass: &Mutex<Pass>, key: &RunKey, watch: &Watch) -> Duration {
    let mut asked = vec![0; world().size() as usize];
    let (mut stopped, mut busy) = (None, Duration::ZERO);
    loop {
        if stopped.is_none() {
            // Give each rank two pieces
            for (rank, asked) in asked.iter_mut().enumerate().skip(1) {
                while *asked < 2 {
                    let Some(piece) = locked(pass).take() else { break };
                    send(rank as Rank, Order::Render(piece));
                    *asked += 1;
                }
            }
            if !watch(0) {
                stopped = Some(Instant::now());
                send_all(Order::Stop);
            }
        }
        // Return if no answer is to come
        let late = asked.iter().sum();
        if late == 0 || stopped.is_some_and(|at| at.elapsed() > GRACE) {
            OUTSTANDING.store(late, Relaxed);
            return busy;
        }
        // Receive the sums of a piece
        let began = Instant::now();
        let Some((rank, bytes)) = answer() else {
            thread::sleep(POLL);
            continue;
        };
        asked[rank] -= 1;
        if let Some(mut part) = Part::from_bytes(&bytes, key) {
            let mut pass = locked(pass);
            let before = &pass.shares[rank];
            part.share.sent_bytes = before.sent_bytes + bytes.len() as u64;
            watch(part.share.paths - before.paths);
            pass.add(rank, part);
        }
        busy += began.elapsed();
    }
}

/// The seconds that all threads of this process have computed.
fn processor_seconds() -> f64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    let clock = libc::CLOCK_PROCESS_CPUTIME_ID;
    // SAFETY: the time is written, and nothing else.
    unsafe { libc::clock_gettime(clock, &mut time) };
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}

#[cfg(test)]
#[path = "../tests/units/pieces.rs"]
mod tests;
