// Tangled from chapters/plan.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! The program that uses the library: it receives events, and may be one of
//! several processes.
//!
//! ```
//! use litpt::host::{Event, Host, Interrupt};
//!
//! let listen = |event| if let Event::Warning(text) = event {
//!     eprintln!("{text}");
//! };
//! let host = Host { listen: &listen, ..Host::default() };
//! host.warn("nothing is wrong");
//! let interrupt = Interrupt::default();
//! interrupt.cancel();
//! assert_eq!(interrupt.signal(), Some(1));
//! ```

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use crate::error::Diagnostic;
use crate::integrator::{Communicator, SingleProcess};

/// An event while a scene is prepared or rendered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Event {
    /// Something may not be what it seems.
    Warning(String),
    /// Something is good to know.
    Note(String),
    /// A stage begins, of so many steps if that is known.
    Stage(String, Option<u64>),
    /// So many steps of the stage are done.
    Steps(u64),
}

/// The program that uses the library.
#[derive(Clone, Copy)]
pub struct Host<'a> {
    /// Receives events, from any thread.
    pub listen: &'a (dyn Fn(Event) + Sync),
    /// The processes that render together.
    pub ranks: &'a dyn Communicator,
    /// When the program began: limits of time count from here.
    pub start: Instant,
}

/// One process, which ignores events.
impl Default for Host<'_> {
    fn default() -> Self {
        Self {
            listen: &|_| (),
            ranks: &SingleProcess,
            start: Instant::now(),
        }
    }
}

impl Host<'_> {
    /// Warns with a text.
    pub fn warn(&self, text: impl Into<String>) {
        (self.listen)(Event::Warning(text.into()));
    }

    /// Warns of oddities in a file.
    pub fn warn_all(&self, file: &str, odd: Vec<Diagnostic>) {
        odd.into_iter()
            .for_each(|it| self.warn(it.of_file(file).to_string()));
    }

    /// Reports that a stage begins, of so many steps if that is known.
    pub fn enter(&self, stage: impl Into<String>, steps: Option<u64>) {
        (self.listen)(Event::Stage(stage.into(), steps));
    }
}

/// Cancels a run; its clones cancel the same.
#[derive(Clone, Default)]
pub struct Interrupt(Arc<AtomicUsize>);

impl Interrupt {
    /// Requests the end of the run.
    pub fn cancel(&self) {
        self.0.store(1, Ordering::Relaxed);
    }

    /// Permits a next run to begin.
    pub fn reset(&self) {
        self.0.store(0, Ordering::Relaxed);
    }

    /// The cell for the number of a signal, which cancels the run.
    pub fn cell(&self) -> Arc<AtomicUsize> {
        self.0.clone()
    }

    /// The signal that has cancelled the run, if it is cancelled: 1 if it
    /// was no signal.
    pub fn signal(&self) -> Option<i32> {
        let signal = self.0.load(Ordering::Relaxed) as i32;
        (signal != 0).then_some(signal)
    }
}
