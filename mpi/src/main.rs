// Tangled from chapters/mpi.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The command `pt-mpi`: one run on many processes, which send each other
//! messages.
//!
//! Rank 0 leads: it has the film and hands out pieces of each pass. The
//! others follow: they render pieces and send the sums back.

use std::process::{self, ExitCode};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{self, Receiver, Sender};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use std::{iter, panic, thread};

use litpt::film::{Film, SIDE, Watch, Window};
use litpt::progress;
use litpt::render::{Renderer, Share};
use litpt::session::{self, Ranks};
use litpt::state::key::RunKey;
use litpt::statistics::Accumulator;
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;
use mpi::{Rank, Threading};
use serde::{Deserialize, Serialize};

/// The processes that MPI has started.
struct World;

impl Ranks for World {
    fn count(&self) -> u32 {
        world().size() as u32
    }

    fn tell(&self, bytes: &mut [u8]) {
        if self.count() > 1 {
            send_all(Order::Listen(bytes.len() as u64));
            broadcast(bytes);
        }
    }

    fn hear(&self) -> Option<Vec<u8>> {
        let Order::Listen(length) = next_order() else { return None };
        let mut bytes = vec![0; length as usize];
        broadcast(&mut bytes);
        Some(bytes)
    }

    fn lead<'a>(
        &self,
        own: Box<dyn Renderer + 'a>,
        run_key: &'a RunKey,
    ) -> Box<dyn Renderer + 'a> {
        if self.count() == 1 {
            return own;
        }
        let shares = vec![Share::default(); self.count() as usize];
        let before = processor_seconds();
        Box::new(Leader { own, run_key, shares, before, least: 0. })
    }

    fn serve(&self, renderer: &mut dyn Renderer, run_key: &RunKey) {
        let stop = AtomicBool::new(false);
        let (pieces, todo) = mpsc::channel();
        let (done, parts) = mpsc::channel();
        let before = processor_seconds();
        thread::scope(|scope| {
            scope.spawn(|| exchange(pieces, parts, &stop));
            let watch = |_| !stop.load(Ordering::Relaxed);
            for piece in todo {
                let piece = (piece, run_key);
                let part = Part::render(piece, renderer, &watch, before);
                let _ = done.send(part.to_bytes());
            }
        });
    }
}

fn main() -> ExitCode {
    let begun = mpi::initialize_with_threading(Threading::Serialized);
    let Some((_universe, Threading::Serialized | Threading::Multiple)) =
        begun
    else {
        progress::error("MPI does not allow for threads");
        return ExitCode::FAILURE;
    };
    abort_on_panic();
    match world().rank() {
        0 => shutdown(session::lead(&World)),
        rank => follow(rank),
    }
}

fn follow(rank: Rank) -> ExitCode {
    let Err(message) = session::follow(&World) else {
        return ExitCode::SUCCESS;
    };
    if next_order() != Order::End {
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

/// How long rank 0 waits for answers when it is asked to stop.
const GRACE: Duration = Duration::from_millis(250);

/// Ends the run of the other ranks.
fn shutdown(status: ExitCode) -> ExitCode {
    let mut late = OUTSTANDING.load(Ordering::Relaxed);
    while late > 0 {
        match answer() {
            Some(_) => late -= 1,
            None => thread::sleep(POLL),
        }
    }
    send_all(Order::End);
    status
}

/// What rank 0 may ask for.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
enum Order {
    /// Listen to so many bytes that are told to all.
    Listen(u64),
    /// Render a piece.
    Render(Piece),
    /// Leave what is not yet rendered.
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

/// The next order of rank 0.
fn next_order() -> Order {
    loop {
        match pending_order() {
            Some(order) => return order,
            None => thread::sleep(POLL),
        }
    }
}

/// The next order, if it is there.
fn pending_order() -> Option<Order> {
    let found = world().process_at_rank(0).immediate_matched_probe();
    let (text, _) = found?.matched_receive_vec::<u8>();
    Some(serde_json::from_slice(&text).unwrap_or(Order::End))
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

impl Piece {
    /// An empty film for it.
    fn film(&self, run_key: &RunKey) -> Film {
        run_key.film_of(self.window, self.first)
    }

    fn paths(&self) -> u64 {
        area(self.window) * self.samples
    }

    /// Two pieces that make up this one, if there are.
    fn halves(self, replicate: u64) -> Option<[Self; 2]> {
        let values = self.samples / replicate;
        match halves(self.window) {
            Some(windows) => {
                Some(windows.map(|window| Self { window, ..self }))
            }
            None if values < 2 => None,
            None => {
                let samples = values / 2 * replicate;
                let first = self.first + samples;
                let rest = self.samples - samples;
                Some([
                    Self { samples, ..self },
                    Self { first, samples: rest, ..self },
                ])
            }
        }
    }
}

fn area(window: Window) -> u64 {
    u64::from(window.size.0) * u64::from(window.size.1)
}

/// Two windows of whole tiles that make up this one, if there are.
fn halves(window: Window) -> Option<[Window; 2]> {
    let Window { corner: (x, y), size: (width, height) } = window;
    let (columns, rows) = (edge(x, width), edge(y, height));
    let part = |corner, size| Window { corner, size };
    match (columns, rows) {
        (Some(at), rows) if width >= height || rows.is_none() => Some([
            part((x, y), (at - x, height)),
            part((at, y), (x + width - at, height)),
        ]),
        (_, Some(at)) => Some([
            part((x, y), (width, at - y)),
            part((x, at), (width, y + height - at)),
        ]),
        _ => None,
    }
}

/// The edge of a tile next to the middle of a range.
fn edge(from: u32, size: u32) -> Option<u32> {
    let middle = from + size / 2;
    let edges = [middle.next_multiple_of(SIDE), middle / SIDE * SIDE];
    edges.into_iter().find(|&at| from < at && at < from + size)
}

/// The pieces of a pass that no rank has got.
struct Schedule {
    /// The next one is the last.
    pieces: Vec<Piece>,
    /// Paths in all of them.
    left: u64,
    /// Pieces of fewer paths are not divided.
    least: u64,
    ranks: u64,
    replicate: u64,
}

impl Schedule {
    /// All that takes a film to so many samples.
    fn new(film: &Film, end: u64, ranks: u64) -> Self {
        let mut pieces = vec![];
        lacking(film, film.window, end, &mut pieces);
        let left: u64 = pieces.iter().map(Piece::paths).sum();
        let least = left / (64 * ranks);
        Self { pieces, left, least, ranks, replicate: film.replicate }
    }

    /// The next piece; it is smaller, the less is left.
    fn take(&mut self) -> Option<Piece> {
        let mut piece = self.pieces.pop()?;
        let most = (self.left / (4 * self.ranks)).max(self.least);
        while piece.paths() > most {
            let Some([half, rest]) = piece.halves(self.replicate) else {
                break;
            };
            self.pieces.push(rest);
            piece = half;
        }
        self.left -= piece.paths();
        Some(piece)
    }
}

/// Adds what the tiles of a window lack up to so many samples.
fn lacking(film: &Film, window: Window, end: u64, pieces: &mut Vec<Piece>) {
    let replicate = film.replicate;
    let end = end.div_ceil(replicate) * replicate;
    let samples = corners(window).map(|tile| samples_at(film, tile));
    let (least, most) = samples.fold((u64::MAX, 0), |(least, most), n| {
        (least.min(n), most.max(n))
    });
    if least == most {
        let first = film.first + least;
        let samples = end.saturating_sub(least);
        pieces.extend((samples > 0).then_some(Piece {
            window,
            first,
            samples,
        }));
    } else if let Some(windows) = halves(window) {
        for half in windows {
            lacking(film, half, end, pieces);
        }
    }
}

/// The first pixel of each tile of a window.
fn corners(window: Window) -> impl Iterator<Item = (u32, u32)> {
    let (right, bottom) = window.end();
    let starts = |from: u32, end: u32| {
        iter::successors(Some(from), |at| Some((at / SIDE + 1) * SIDE))
            .take_while(move |&at| at < end)
    };
    let (x, y) = window.corner;
    starts(y, bottom)
        .flat_map(move |y| starts(x, right).map(move |x| (x, y)))
}

/// The samples of a pixel of a film.
fn samples_at(film: &Film, (x, y): (u32, u32)) -> u64 {
    film.pixel(x, y).count() * film.replicate
}

/// The sums of a piece, and what they have cost.
struct Part {
    piece: Piece,
    film: Film,
    rays: u64,
    share: Share,
}

impl Part {
    /// Renders a piece, unless `watch` stops it, in a process that had computed
    /// for so many seconds before.
    fn render(
        (piece, run_key): (Piece, &RunKey),
        renderer: &mut dyn Renderer,
        watch: &Watch,
        before: f64,
    ) -> Self {
        let (began, mut film) = (Instant::now(), piece.film(run_key));
        let rays = renderer.pass(&mut film, piece.samples, watch);
        let paths = film.pixels.iter().map(Accumulator::count);
        let share = Share {
            paths: paths.sum::<u64>() * film.replicate,
            render_seconds: began.elapsed().as_secs_f64(),
            processor_seconds: processor_seconds() - before,
            ..Share::default()
        };
        Self { piece, film, rays, share }
    }

    fn to_bytes(&self) -> Vec<u8> {
        let Self { piece, film, rays, share } = self;
        let head = serde_json::to_vec(&(piece, rays, share));
        let mut bytes = head.unwrap_or_default();
        bytes.push(b'\n');
        let sums = film.pixels.iter().chain(&film.tile_means);
        bytes.extend(sums.flat_map(Accumulator::to_bytes));
        bytes
    }

    fn from_bytes(bytes: &[u8], run_key: &RunKey) -> Option<Self> {
        let end = bytes.iter().position(|&byte| byte == b'\n')?;
        let head = serde_json::from_slice(&bytes[..end]);
        let (piece, rays, mut share): (Piece, _, Share) = head.ok()?;
        share.sent_bytes = bytes.len() as u64;
        let mut film = piece.film(run_key);
        let (sums, _) = bytes[end + 1..].as_chunks();
        let mut sums = sums.iter().map(Accumulator::from_bytes);
        let mut fill = |all: &mut [Accumulator]| {
            all.iter_mut().zip(&mut sums).for_each(|(own, sum)| *own = sum);
        };
        fill(&mut film.pixels);
        fill(&mut film.tile_means);
        Some(Self { piece, film, rays, share })
    }
}

/// The film of a pass, and what all ranks have spent on it.
struct Collector<'a> {
    film: &'a mut Film,
    /// Parts that samples are missing before.
    waiting: Vec<Part>,
    /// The rays of all parts.
    rays: u64,
    /// What each rank has done.
    shares: &'a mut [Share],
}

impl<'a> Collector<'a> {
    fn new(film: &'a mut Film, shares: &'a mut [Share]) -> Self {
        Self { film, waiting: vec![], rays: 0, shares }
    }

    /// Takes a part of a rank.
    fn add(&mut self, rank: usize, part: Part) {
        let share = &mut self.shares[rank];
        share.paths += part.share.paths;
        share.render_seconds += part.share.render_seconds;
        share.sent_bytes += part.share.sent_bytes;
        share.processor_seconds = part.share.processor_seconds;
        self.rays += part.rays;
        self.waiting.push(part);
        while let Some(k) =
            self.waiting.iter().position(|w| self.follows(w))
        {
            let part = self.waiting.swap_remove(k);
            self.film.merge(&part.film);
        }
    }

    /// Whether the film has all samples before those of a part.
    fn follows(&self, part: &Part) -> bool {
        let Piece { window, first, .. } = part.piece;
        self.film.first + samples_at(self.film, window.corner) == first
    }
}

/// A renderer on all ranks.
struct Leader<'a> {
    own: Box<dyn Renderer + 'a>,
    run_key: &'a RunKey,
    shares: Vec<Share>,
    /// The processor time before the first pass.
    before: f64,
    /// Seconds below which a pass is too short.
    least: f64,
}

impl Renderer for Leader<'_> {
    fn pass(&mut self, film: &mut Film, end: u64, watch: &Watch) -> u64 {
        let Self { own, run_key, shares, before, least } = self;
        let (began, run_key) = (Instant::now(), *run_key);
        let ranks = shares.len() as u64;
        let done = |share: &Share| share.render_seconds;
        let rendered: Vec<f64> = shares.iter().map(done).collect();
        let schedule = Mutex::new(Schedule::new(film, end, ranks));
        let collector = Mutex::new(Collector::new(film, shares));
        let busy = thread::scope(|scope| {
            let hand_out =
                || hand_out(&schedule, &collector, run_key, watch);
            let progress = scope.spawn(hand_out);
            // Render pieces until none is left
            while watch(0) {
                let Some(piece) = locked(&schedule).take() else { break };
                let part = Part::render(
                    (piece, run_key),
                    &mut **own,
                    watch,
                    *before,
                );
                locked(&collector).add(0, part);
            }
            progress.join().unwrap_or_default().as_secs_f64()
        });
        let rays = locked(&collector).rays;
        drop(collector);
        // Tell how long each rank has waited
        let wall = began.elapsed().as_secs_f64();
        *least = 8. * busy;
        shares[0].collect_seconds += busy;
        for (share, before) in shares.iter_mut().zip(rendered) {
            let waited = wall - (share.render_seconds - before);
            share.wait_seconds += waited.max(0.);
        }
        rays
    }

    fn shares(&self) -> &[Share] {
        &self.shares
    }

    fn least_seconds(&self) -> f64 {
        self.least
    }
}

/// What two threads share, for this one alone.
fn locked<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Answers that are still to come at the end of a run.
static OUTSTANDING: AtomicUsize = AtomicUsize::new(0);

/// Gives pieces to the other ranks and takes their sums, until all is
/// done or `watch` stops it; returns the time that the sums have taken.
fn hand_out(
    schedule: &Mutex<Schedule>,
    collector: &Mutex<Collector>,
    run_key: &RunKey,
    watch: &Watch,
) -> Duration {
    let mut asked = vec![0; world().size() as usize];
    let (mut stopped, mut busy) = (None, Duration::ZERO);
    loop {
        if stopped.is_none() {
            // Give each rank two pieces
            for (rank, asked) in asked.iter_mut().enumerate().skip(1) {
                while *asked < 2 {
                    let Some(piece) = locked(schedule).take() else {
                        break;
                    };
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
        let is_over = |since: Instant| since.elapsed() > GRACE;
        if late == 0 || stopped.is_some_and(is_over) {
            OUTSTANDING.store(late, Ordering::Relaxed);
            return busy;
        }
        // Take the sums of a piece
        let began = Instant::now();
        let Some((rank, bytes)) = answer() else {
            thread::sleep(POLL);
            continue;
        };
        asked[rank] -= 1;
        if let Some(part) = Part::from_bytes(&bytes, run_key) {
            watch(part.share.paths);
            locked(collector).add(rank, part);
        }
        busy += began.elapsed();
    }
}

/// Passes orders on, and sends the sums of pieces, until the end.
fn exchange(
    pieces: Sender<Piece>,
    parts: Receiver<Vec<u8>>,
    stop: &AtomicBool,
) {
    loop {
        match pending_order() {
            Some(Order::Render(piece)) => _ = pieces.send(piece),
            Some(Order::Stop) => stop.store(true, Ordering::Relaxed),
            Some(_) => return,
            None => match parts.try_recv() {
                Ok(part) => report(&part),
                Err(_) => thread::sleep(POLL),
            },
        }
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
