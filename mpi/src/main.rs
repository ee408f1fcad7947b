// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
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
use std::{array, iter, panic, thread};

use litpt::film::{Film, SIDE, Watch, Window};
use litpt::progress;
use litpt::render::{Renderer, Share};
use litpt::session::{self, Frame, Ranks};
use litpt::statistics::Accumulator;
use mpi::topology::SimpleCommunicator;
use mpi::traits::*;
use mpi::{Rank, Threading};

/// The processes that MPI has started.
struct World;

impl Ranks for World {
    fn count(&self) -> u32 {
        ranks() as u32
    }

    fn tell(&self, bytes: &mut [u8]) {
        tell(bytes);
    }

    fn hear(&self) -> Option<Vec<u8>> {
        hear()
    }

    fn lead<'a>(
        &self,
        own: Box<dyn Renderer + 'a>,
        frame: Frame,
    ) -> Box<dyn Renderer + 'a> {
        lead(own, frame)
    }

    fn serve(&self, renderer: &mut dyn Renderer, frame: &Frame) {
        serve(renderer, frame);
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

impl Order {
    fn to_words(self) -> [u64; 7] {
        let with =
            |kind, [a, b, c, d, e, f]: [u64; 6]| [kind, a, b, c, d, e, f];
        match self {
            Order::Listen(length) => with(0, [length, 0, 0, 0, 0, 0]),
            Order::Render(piece) => with(1, piece.to_words()),
            Order::Stop => with(2, [0; 6]),
            Order::End => with(3, [0; 6]),
        }
    }

    fn from_words([kind, words @ ..]: [u64; 7]) -> Self {
        match kind {
            0 => Order::Listen(words[0]),
            1 => Order::Render(Piece::from_words(words)),
            2 => Order::Stop,
            _ => Order::End,
        }
    }
}

/// The time between two looks for a message.
const POLL: Duration = Duration::from_micros(500);

/// The group of all ranks.
fn world() -> SimpleCommunicator {
    SimpleCommunicator::world()
}

/// The number of ranks.
fn ranks() -> i32 {
    world().size()
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
    let (message, _) = found?;
    let mut words = [0u64; 7];
    message.matched_receive_into(&mut words[..]);
    Some(Order::from_words(words))
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
    world().process_at_rank(rank).send(&order.to_words()[..]);
}

/// Sends an order to all other ranks.
fn send_all(order: Order) {
    (1..ranks()).for_each(|rank| send(rank, order));
}

/// Tells all other ranks something, which they [`hear`].
fn tell(bytes: &mut [u8]) {
    if ranks() > 1 {
        send_all(Order::Listen(bytes.len() as u64));
        broadcast(bytes);
    }
}

/// What rank 0 tells; none if there is nothing more to do.
fn hear() -> Option<Vec<u8>> {
    let Order::Listen(length) = next_order() else { return None };
    let mut bytes = vec![0; length as usize];
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
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Piece {
    window: Window,
    /// The samples of each pixel before its own.
    first: u64,
    samples: u64,
}

impl Piece {
    /// An empty film for it.
    fn film(&self, frame: &Frame) -> Film {
        let film = frame.sampling.film(frame.resolution, self.window);
        film.as_part(frame.whole, self.first)
    }

    fn paths(&self) -> u64 {
        area(self.window) * self.samples
    }

    fn to_words(self) -> [u64; 6] {
        let Self { window: Window { corner, size }, .. } = self;
        let [x, y, w, h] =
            [corner.0, corner.1, size.0, size.1].map(u64::from);
        [x, y, w, h, self.first, self.samples]
    }

    fn from_words([x, y, w, h, first, samples]: [u64; 6]) -> Self {
        let pair = |a: u64, b: u64| (a as u32, b as u32);
        let window = Window { corner: pair(x, y), size: pair(w, h) };
        Self { window, first, samples }
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
        lacking(film, film.window(), end, &mut pieces);
        let left: u64 = pieces.iter().map(Piece::paths).sum();
        let least = left / (64 * ranks);
        Self { pieces, left, least, ranks, replicate: film.replicate() }
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
    let replicate = film.replicate();
    let end = end.div_ceil(replicate) * replicate;
    let samples = corners(window).map(|tile| samples_at(film, tile));
    let (least, most) = samples.fold((u64::MAX, 0), |(least, most), n| {
        (least.min(n), most.max(n))
    });
    if least == most {
        let first = film.first() + least;
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
    film.pixel(x, y).count() * film.replicate()
}

/// The sums of a piece, and what they have cost.
struct Part {
    piece: Piece,
    film: Film,
    spent: Spent,
}

/// What a rank has spent.
#[derive(Clone, Copy, Debug, Default)]
struct Spent {
    rays: u64,
    /// Nanoseconds of rendering the piece.
    nanoseconds: u64,
    /// Nanoseconds of all its processors since it began to render.
    processor: u64,
    /// Bytes of messages.
    bytes: u64,
}

impl Part {
    /// Renders a piece, unless `watch` stops it.
    fn render(
        piece: Piece,
        frame: &Frame,
        renderer: &mut dyn Renderer,
        watch: &Watch,
    ) -> Self {
        let (began, mut film) = (Instant::now(), piece.film(frame));
        let rays = renderer.pass(&mut film, piece.samples, watch);
        let nanoseconds = began.elapsed().as_nanos() as u64;
        let (processor, bytes) = (processor_time(), 0);
        let spent = Spent { rays, nanoseconds, processor, bytes };
        Self { piece, film, spent }
    }

    fn to_bytes(&self) -> Vec<u8> {
        let Spent { rays, nanoseconds, processor, .. } = self.spent;
        let words = self.piece.to_words().into_iter();
        let words = words.chain([rays, nanoseconds, processor]);
        let mut bytes: Vec<u8> = words.flat_map(u64::to_le_bytes).collect();
        let sums = self.film.stored().iter().chain(self.film.tile_means());
        bytes.extend(sums.flat_map(Accumulator::to_bytes));
        bytes
    }

    fn from_bytes(bytes: &[u8], frame: &Frame) -> Self {
        let (head, sums) = bytes.split_at(9 * 8);
        let word = |k: usize| {
            let word = head[8 * k..].first_chunk();
            word.map_or(0, |&word| u64::from_le_bytes(word))
        };
        let piece = Piece::from_words(array::from_fn(word));
        let mut film = piece.film(frame);
        let (sums, _) = sums.as_chunks();
        let mut sums = sums.iter().map(Accumulator::from_bytes);
        let mut fill = |all: &mut [Accumulator]| {
            all.iter_mut().zip(&mut sums).for_each(|(own, sum)| *own = sum);
        };
        fill(film.stored_mut());
        fill(film.tile_means_mut());
        let (rays, nanoseconds, processor) = (word(6), word(7), word(8));
        let bytes = bytes.len() as u64;
        let spent = Spent { rays, nanoseconds, processor, bytes };
        Self { piece, film, spent }
    }
}

/// The film of a pass, and what all ranks have spent on it.
struct Collector<'a> {
    film: &'a mut Film,
    /// Parts that samples are missing before.
    waiting: Vec<(usize, Part)>,
    /// For each rank, the paths and what they have cost.
    spent: Vec<(u64, Spent)>,
}

impl Collector<'_> {
    /// Takes a part of a rank, and returns the paths that it has.
    fn add(&mut self, rank: usize, part: Part) -> u64 {
        // Add what a part has cost
        let (paths, sum) = &mut self.spent[rank];
        let more = part.film.stored().iter().map(Accumulator::count);
        let more = more.sum::<u64>() * part.film.replicate();
        *paths += more;
        sum.rays += part.spent.rays;
        sum.nanoseconds += part.spent.nanoseconds;
        sum.bytes += part.spent.bytes;
        sum.processor = part.spent.processor;
        self.waiting.push((rank, part));
        while let Some(k) =
            self.waiting.iter().position(|w| self.follows(&w.1))
        {
            let (_, part) = self.waiting.swap_remove(k);
            self.film.merge(&part.film);
        }
        more
    }

    /// Whether the film has all samples before those of a part.
    fn follows(&self, part: &Part) -> bool {
        let Piece { window, first, .. } = part.piece;
        self.film.first() + samples_at(self.film, window.corner) == first
    }
}

/// A renderer on all ranks.
struct Leader<'a> {
    own: Box<dyn Renderer + 'a>,
    frame: Frame,
    shares: Vec<Share>,
    /// The processor time before the first pass.
    before: u64,
    /// Seconds below which a pass is too short.
    least: f64,
}

/// The renderer of rank 0, for a run of all ranks.
fn lead<'a>(
    own: Box<dyn Renderer + 'a>,
    frame: Frame,
) -> Box<dyn Renderer + 'a> {
    let ranks = ranks() as usize;
    if ranks == 1 {
        return own;
    }
    let (shares, before) =
        (vec![Share::default(); ranks], processor_time());
    Box::new(Leader { own, frame, shares, before, least: 0. })
}

impl Renderer for Leader<'_> {
    fn pass(&mut self, film: &mut Film, end: u64, watch: &Watch) -> u64 {
        let (began, frame) = (Instant::now(), self.frame);
        let ranks = self.shares.len();
        let schedule = Mutex::new(Schedule::new(film, end, ranks as u64));
        let spent = vec![Default::default(); ranks];
        let collector = Collector { film, waiting: vec![], spent };
        let collector = Mutex::new(collector);
        let busy = thread::scope(|scope| {
            let hand_out =
                || hand_out(&schedule, &collector, &frame, watch);
            let progress = scope.spawn(hand_out);
            // Render pieces until none is left
            while watch(0) {
                let Some(piece) = locked(&schedule).take() else { break };
                let own = &mut *self.own;
                let part = Part::render(piece, &frame, own, watch);
                locked(&collector).add(0, part);
            }
            progress.join().unwrap_or_default()
        });
        let spent = locked(&collector).spent.clone();
        // Count what each rank has done
        let wall = began.elapsed().as_secs_f64();
        self.least = 8. * busy.as_secs_f64();
        self.shares[0].collect_seconds += busy.as_secs_f64();
        for (rank, (share, (paths, spent))) in
            self.shares.iter_mut().zip(&spent).enumerate()
        {
            let seconds = spent.nanoseconds as f64 / 1e9;
            share.paths += paths;
            share.sent_bytes += spent.bytes;
            share.render_seconds += seconds;
            share.wait_seconds += (wall - seconds).max(0.);
            if *paths > 0 {
                let before = if rank == 0 { self.before } else { 0 };
                share.processor_seconds =
                    (spent.processor - before) as f64 / 1e9;
            }
        }
        spent.iter().map(|(_, spent)| spent.rays).sum()
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
    frame: &Frame,
    watch: &Watch,
) -> Duration {
    let mut asked = vec![0; ranks() as usize];
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
        let part = Part::from_bytes(&bytes, frame);
        let paths = locked(collector).add(rank, part);
        busy += began.elapsed();
        asked[rank] -= 1;
        watch(paths);
    }
}

/// Renders pieces for rank 0 until there is nothing more to do.
fn serve(renderer: &mut dyn Renderer, frame: &Frame) {
    let stop = AtomicBool::new(false);
    let (pieces, todo) = mpsc::channel();
    let (done, parts) = mpsc::channel();
    let before = processor_time();
    thread::scope(|scope| {
        scope.spawn(|| exchange(pieces, parts, &stop));
        let watch = |_| !stop.load(Ordering::Relaxed);
        for piece in todo {
            let mut part = Part::render(piece, frame, renderer, &watch);
            part.spent.processor -= before;
            let _ = done.send(part.to_bytes());
        }
    });
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

/// The nanoseconds that all threads of this process have computed.
fn processor_time() -> u64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    let clock = libc::CLOCK_PROCESS_CPUTIME_ID;
    // SAFETY: the time is written, and nothing else.
    unsafe { libc::clock_gettime(clock, &mut time) };
    time.tv_sec as u64 * 1_000_000_000 + time.tv_nsec as u64
}

#[cfg(test)]
#[path = "../tests/units/pieces.rs"]
mod tests;
