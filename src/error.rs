// Tangled from chapters/errors.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later
//! Errors, as one type, and warnings about files.
//!
//! ```
//! use litpt::error::Error;
//! use litpt::scene::read_obj;
//!
//! let error = read_obj(b"v 0 0 o\n").unwrap_err().of_file("room.obj");
//! assert_eq!(error.to_string(), "room.obj:1: z = o is no number");
//! assert!(matches!(error, Error::Content(fault) if fault.line == Some(1)));
//! ```

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::{fmt, io};

use serde::{Deserialize, Serialize};

/// A message about a file, or about data from elsewhere.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Diagnostic {
    /// The name of the file; empty if there is none, or none yet.
    pub file: String,
    /// The line in it, from 1.
    pub line: Option<usize>,
    /// What is wrong there, or odd.
    pub text: String,
}

impl Diagnostic {
    /// Adds this file, unless there is one already.
    pub fn of_file(mut self, file: impl AsRef<Path>) -> Self {
        if self.file.is_empty() {
            self.file = file.as_ref().display().to_string();
        }
        self
    }
}

impl<T: Into<String>> From<T> for Diagnostic {
    fn from(text: T) -> Self {
        Self { text: text.into(), ..Self::default() }
    }
}

impl std::error::Error for Diagnostic {}

impl fmt::Display for Diagnostic {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        let Self { file, line, text } = self;
        match (&file[..], line) {
            ("", None) => write!(out, "{text}"),
            ("", Some(line)) => write!(out, "line {line}: {text}"),
            (_, None) => write!(out, "{file}: {text}"),
            (_, Some(line)) => write!(out, "{file}:{line}: {text}"),
        }
    }
}

/// The reason why the library cannot do something. Each displays as one
/// line, without a full stop.
#[derive(thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file, or data from elsewhere, has a fault.
    #[error(transparent)]
    Content(#[from] Diagnostic),
    /// The system refuses an action on a file, such as `read`.
    #[error("{file}: cannot {action}: {source}")]
    File {
        /// The name of the file, for people.
        file: String,
        /// A verb.
        action: &'static str,
        /// The reason of the system.
        source: io::Error,
    },
    /// A file was finished, but could not be given its name.
    #[error("{cause}; the new one is kept as {}", kept.display())]
    Kept {
        /// The reason.
        cause: Box<Error>,
        /// The place where it is now.
        kept: PathBuf,
    },
    /// An argument cannot have this value.
    #[error("{fault}")]
    Value {
        /// The name of the argument.
        name: &'static str,
        /// The value, as it was given.
        value: String,
        /// The whole message.
        fault: String,
    },
    /// The memory does not suffice; the message explains for what.
    #[error("{0}")]
    Memory(String),
}

/// A value, or the reason why there is none.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl<T: Into<Cow<'static, str>>> From<T> for Error {
    fn from(text: T) -> Self {
        Self::Content(Diagnostic::from(text.into()))
    }
}

/// As it displays, so that a `main` that returns it prints a sentence.
impl fmt::Debug for Error {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        fmt::Display::fmt(self, out)
    }
}

impl Error {
    /// Adds this file, if it is an error of content without a file.
    pub fn of_file(self, file: impl AsRef<Path>) -> Self {
        match self {
            Self::Content(fault) => Self::Content(fault.of_file(file)),
            other => other,
        }
    }

    /// Turns an error of the system into that of an action on a file.
    pub fn cannot(
        action: &'static str,
        file: impl AsRef<Path>,
    ) -> impl FnOnce(io::Error) -> Self {
        let file = file.as_ref().display().to_string();
        move |source| Self::File { file, action, source }
    }

    /// The error of an argument.
    pub fn value(
        name: &'static str,
        value: impl ToString,
        fault: impl Into<String>,
    ) -> Self {
        let (value, fault) = (value.to_string(), fault.into());
        Self::Value { name, value, fault }
    }
}
