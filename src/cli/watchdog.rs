// Tangled from chapters/program.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Signals, and a thread that ends a program without an image when one of
//! them comes, or when its time is over.

use std::process;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant};
use std::{io, mem, ptr, thread};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGUSR2};
use signal_hook::consts::{SIGXCPU, SIGXFSZ};
use signal_hook::flag;

use super::progress::{self, ProgressBar};
use crate::error::Result;
use crate::host::{Event, Interrupt};
use crate::plan::Budget;
use crate::render_loop::Stop;

/// Begins to listen for SIGINT, SIGTERM and SIGHUP, the second of which
/// ends the program at once, and for warnings; each unless it is ignored.
///
/// # Errors
/// The system refuses.
pub fn listen() -> Result<Interrupt> {
    register().map_err(|e| format!("cannot listen for signals: {e}").into())
}

fn register() -> io::Result<Interrupt> {
    let interrupt = Interrupt::default();
    let again = Arc::new(AtomicBool::new(false));
    // A file beyond the limit of size is an error, not the end.
    flag::register(SIGXFSZ, Arc::default())?;
    let ends = [SIGINT, SIGTERM, SIGHUP];
    let signals = ends.into_iter().chain([SIGXCPU, SIGUSR1, SIGUSR2]);
    for signal in signals.filter(|&signal| !is_ignored(signal)) {
        // Register what a signal does
        if ends.contains(&signal) {
            let shut_down = flag::register_conditional_shutdown;
            shut_down(signal, 128 + signal, again.clone())?;
            flag::register(signal, again.clone())?;
        }
        flag::register_usize(signal, interrupt.cell(), signal as usize)?;
    }
    Ok(interrupt)
}

/// Whether this process ignores a signal.
fn is_ignored(signal: i32) -> bool {
    // SAFETY: zeros are an action, and the call replaces it with another.
    unsafe {
        let mut action: libc::sigaction = mem::zeroed();
        libc::sigaction(signal, ptr::null(), &mut action) == 0
            && action.sa_sigaction == libc::SIG_IGN
    }
}

/// What the program does, with its line on the terminal.
pub struct Stage {
    name: String,
    line: ProgressBar,
    /// Whether there is an image to write.
    renders: bool,
}

/// Follows the stages of a program, draws them, and ends it in time.
#[derive(Clone)]
pub struct Watchdog {
    stage: Arc<Mutex<Stage>>,
    /// What a signal cancels.
    pub interrupt: Interrupt,
}

impl Watchdog {
    /// Starts the thread, with the time at which it ends the program.
    pub fn spawn(interrupt: Interrupt, end: Option<Instant>) -> Self {
        let (name, line) = ("starting".to_owned(), ProgressBar::hidden());
        let stage = Stage { name, line, renders: false };
        let stage = Arc::new(Mutex::new(stage));
        let watchdog = Self { stage, interrupt };
        let shared = watchdog.clone();
        thread::spawn(move || {
            loop {
                thread::sleep(Duration::from_millis(50));
                let stage = shared.stage();
                // Answer a signal, or the end of the time
                let signal = shared.interrupt.signal().map(Stop::Signal);
                let is_over = end.is_some_and(|end| Instant::now() >= end);
                match signal.or(is_over.then_some(Stop::Time)) {
                    Some(stop) if !stage.renders => {
                        progress::error(&without_image(stop, &stage.name));
                        process::exit(status(stop, 1).into());
                    }
                    Some(Stop::Signal(_)) => {
                        return progress::answer(&stage.line);
                    }
                    _ => (),
                }
            }
        });
        watchdog
    }

    fn stage(&self) -> MutexGuard<'_, Stage> {
        self.stage.lock().expect("no panic with the lock")
    }

    /// Shows an event of the library to the user.
    pub fn hear(&self, event: Event) {
        let say = |print: fn(&str), text: &str| {
            let line = self.stage().line.clone();
            line.suspend(|| print(text));
        };
        match event {
            Event::Warning(text) => say(progress::warn, &text),
            Event::Note(text) => say(progress::inform, &text),
            Event::Steps(n) => self.stage().line.set_position(n),
            Event::Stage(name, steps) => {
                self.stage().line.finish_and_clear();
                let line = progress::step(name.clone(), steps);
                self.enter(Stage { name, line, renders: false });
            }
        }
    }

    /// Records that the program renders, and can write an image from now on.
    pub fn renders(&self, line: ProgressBar) {
        let name = "rendering".to_owned();
        self.enter(Stage { name, line, renders: true });
    }

    fn enter(&self, stage: Stage) {
        let old = mem::replace(&mut *self.stage(), stage);
        old.line.finish_and_clear();
    }
}

/// The time at which a program ends even if it has no sample.
pub fn hard_deadline(budget: &Budget, start: Instant) -> Option<Instant> {
    let more = (0.025 * budget.time?).max(0.5);
    let more = Duration::try_from_secs_f64(more).ok()?;
    budget.deadline(start)?.checked_add(more)
}

/// The message that a stop during some work leaves no image.
pub fn without_image(stop: Stop, doing: &str) -> String {
    match stop {
        Stop::Signal(signal) => {
            format!("no image: signal {signal} came while {doing}")
        }
        _ => format!("no image: --time ran out while {doing}"),
    }
}

/// The exit status of a stop, which is `other` if it is no signal.
pub fn status(stop: Stop, other: u8) -> u8 {
    if let Stop::Signal(signal) = stop { 128 + signal as u8 } else { other }
}
