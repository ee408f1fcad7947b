// Tangled from noweb/chapters/positions.nw; edit there.
// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Positions of the program, and where in the chapters they come from.
//!
//! The program is tangled in memory. Columns are bytes, from 1, unless
//! they are said to be characters.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::fs;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::rc::Rc;

use crate::diagnostic::{Position, bytes_of, text_of};
use crate::project::{Project, hash};
use crate::stream::lines;
use crate::tangle::Tangled;
use crate::web::Web;

/// The programs of some webs in memory, and the chapters they come from.
#[derive(Default)]
pub struct Atlas {
    dir: PathBuf,
    files: BTreeMap<PathBuf, TangledFile>,
}

pub struct TangledFile {
    pub project: usize,
    web: Rc<Web>,
    tangled: Tangled,
    /// The file on the disk is the same.
    pub fresh: bool,
}

impl Atlas {
    /// The programs of those projects that can be tangled.
    pub fn read(projects: &[Project]) -> Self {
        let mut atlas = Self::default();
        for (project, of) in projects.iter().enumerate() {
            // Errors in chapters are reported by the command that tangles.
            let Ok(program) = of.expand() else { continue };
            let dir = of.dir.join(".");
            atlas.dir = fs::canonicalize(&dir).unwrap_or(dir).join("");
            let web = Rc::new(program.web);
            for (path, tangled) in program.files {
                // Add a file of the program
                let disk = fs::read(atlas.dir.join(&path));
                let text = hash(&tangled.text);
                let fresh = disk.is_ok_and(|disk| hash(&disk) == text);
                let web = web.clone();
                let file = TangledFile { project, web, tangled, fresh };
                atlas.files.insert(path, file);
            }
        }
        atlas
    }

    /// The file of a program whose path a text ends with, if that is clear,
    /// and where the path begins.
    pub fn find(&self, text: &[u8]) -> Option<(usize, &TangledFile)> {
        let dir = self.dir.as_os_str().as_bytes();
        let known = self.files.iter().filter_map(|(path, file)| {
            let before = text.strip_suffix(path.as_os_str().as_bytes())?;
            let before = before.strip_suffix(dir).unwrap_or(before);
            let start = before.len();
            (path_start(before) == start).then_some((start, file))
        });
        let first = known.min_by_key(|(start, _)| *start);
        first.or_else(|| self.find_end(text))
    }

    fn find_end(&self, text: &[u8]) -> Option<(usize, &TangledFile)> {
        let start = path_start(text);
        let path = Path::new(OsStr::from_bytes(&text[start..]));
        let path = path.strip_prefix(".").ok()?;
        // Find the only file with this end
        let mut ending =
            self.files.iter().filter(|(p, _)| p.ends_with(path));
        let (_, file) = ending.next()?;
        ending.next().is_none().then_some((start, file))
    }
}

impl TangledFile {
    /// Where a position comes from; columns count characters.
    pub fn origin(&self, line: u32, column: u32) -> Option<Position> {
        // Find the bytes before a character
        let index = |number: u32| number.saturating_sub(1) as usize;
        let text = lines(&self.tangled.text).nth(index(line));
        let text = text_of(text.unwrap_or_default());
        let before = text.chars().take(index(column)).collect::<String>();
        let before = bytes_of(&before);
        let place = self.tangled.origin(line, before.len() as u32 + 1)?;
        self.web.position(place)
    }
}

/// Where the path begins that a text ends with, if it is an ordinary one.
pub fn path_start(text: &[u8]) -> usize {
    let inside = |b: &u8| {
        b.is_ascii_alphanumeric() || b"_-+./~".contains(b) || *b >= 0x80
    };
    let path = text.iter().rev().take_while(|b| inside(b)).count();
    let start = text.len() - path;
    let near = start.saturating_sub(24);
    let colour = text[near..].iter().rposition(|b| *b == 0x1b);
    let colour = colour.map(|escape| near + escape);
    start.max(colour.map_or(0, |escape| escape + margin(&text[escape..])))
}

pub fn margin(line: &[u8]) -> usize {
    let mut at = 0;
    loop {
        at += match &line[at..] {
            [b' ', ..] => 1,
            [0x1b, rest @ ..] => {
                match rest.iter().position(u8::is_ascii_alphabetic) {
                    Some(end) => end + 2,
                    None => return at,
                }
            }
            _ => return at,
        };
    }
}
