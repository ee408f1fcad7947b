// Licensed under the GPL, version 3 or later
// Copyright (C) 2026 litpt contributors
//
// This program is free software: you can redistribute it and/or modify it
// under the terms of the GNU General Public License as published by the Free
// Software Foundation, either version 3 of the License, or (at your option)
// any later version. It comes with NO WARRANTY: see COPYING for details.
// SPDX-License-Identifier: GPL-3.0-or-later

//! The compiler's diagnostics, shown in the chapters.
//!
//! A diagnostic is read from JSON. Its spans become stretches of the
//! chapters, and `annotate-snippets` draws it as rustc would.

use std::ops::Range;
use std::path::Path;

use annotate_snippets::{
    Annotation, AnnotationKind, Group, Level, Origin, Patch, Renderer,
    Snippet, normalize_untrusted_str,
};
use serde::Deserialize;

use crate::diagnostic::{Place, Source};
use crate::locate::{Atlas, TangledFile};

// Define what the compiler says
/// A diagnostic of the compiler, or a remark that belongs to one.
#[derive(Deserialize)]
pub struct Message {
    message: String,
    code: Option<Code>,
    level: String,
    spans: Vec<Span>,
    children: Vec<Message>,
    rendered: Option<String>,
}

#[derive(Deserialize)]
struct Code {
    code: String,
}

/// A piece of a file; the end is not included. Columns are characters.
#[derive(Deserialize)]
struct Span {
    file_name: String,
    line_start: u32,
    line_end: u32,
    column_start: u32,
    column_end: u32,
    is_primary: bool,
    label: Option<String>,
    suggested_replacement: Option<String>,
    expansion: Option<Expansion>,
}

#[derive(Deserialize)]
struct Expansion {
    span: Box<Span>,
}

// Read a line of JSON
#[derive(Deserialize)]
struct Envelope {
    reason: String,
    message: Option<Message>,
}

/// What a line of JSON is about.
pub enum Report {
    /// Something to show.
    Diagnostic(Box<Message>),
    /// Something that only programs want to know.
    Progress,
}

/// Reads a line that cargo or rustc has written for programs.
pub fn parse(line: &[u8]) -> Option<Report> {
    if !line.starts_with(b"{") {
        return None;
    }
    let bare =
        || Some(Report::Diagnostic(serde_json::from_slice(line).ok()?));
    let Ok(envelope) = serde_json::from_slice(line) else { return bare() };
    let Envelope { reason, message } = envelope;
    match (&reason[..], message) {
        ("compiler-message", Some(m)) if !m.only_counts() => {
            Some(Report::Diagnostic(Box::new(m)))
        }
        ("compiler-message" | "compiler-artifact", _)
        | ("build-script-executed" | "build-finished", _) => {
            Some(Report::Progress)
        }
        _ => None,
    }
}

impl Message {
    /// Does it only say how many errors or warnings there were?
    fn only_counts(&self) -> bool {
        let text = &self.message;
        let emitted =
            text.ends_with(" emitted") && text.contains(" warning");
        self.spans.is_empty()
            && (text.starts_with("aborting due to ") || emitted)
    }
}

// Show a diagnostic in the chapters
/// The text of a diagnostic, if some of it is in tangled files.
///
/// The text ends with an empty line, as rustc's does.
pub fn show(
    message: &Message,
    atlas: &Atlas,
    renderer: &Renderer,
) -> Option<String> {
    let view = View { atlas, rendered: &message.rendered() };
    if !message.all_spans().any(|span| view.tangled(span).is_some()) {
        return None;
    }
    let text = normalize_untrusted_str(&message.message);
    // Make the title of a diagnostic
    let title = level(&message.level).primary_title(text);
    let title = match &message.code {
        Some(Code { code }) if is_numbered(code) => title.id(code.clone()),
        _ => title,
    };
    let mut marks = view.marks(&message.spans);
    // Put short proposals into labels
    for child in &message.children {
        if view.role(child) != Role::Label {
            continue;
        }
        for mut mark in view.marks(&child.spans) {
            let same = |m: &&mut Mark| {
                m.spot.path == mark.spot.path
                    && m.spot.range == mark.spot.range
            };
            let label = view.short_proposal(child);
            // Give the label to a mark or make one
            match marks.iter_mut().find(same) {
                Some(marked) if marked.label.is_none() => {
                    marked.label = Some(label);
                }
                marked => {
                    mark.primary = marked.is_some_and(|m| m.primary);
                    mark.label = Some(label);
                    marks.push(mark);
                }
            }
        }
    }
    let mut groups = vec![draw(Group::with_title(title), marks)];
    for child in &message.children {
        view.add_child(child, &mut groups);
    }
    Some(renderer.render(&groups) + "\n\n")
}

impl Message {
    // Read more of a diagnostic
    /// The text as the compiler has it, without colours.
    pub fn rendered(&self) -> String {
        let text = self.rendered.as_deref().unwrap_or(&self.message);
        let mut parts = text.split("\x1b[");
        let mut plain = parts.next().unwrap_or("").to_owned();
        for part in parts {
            plain += part.split_once('m').map_or("", |(_, after)| after);
        }
        plain
    }

    /// The same with the colours that it came with.
    pub fn coloured(&self) -> &str {
        self.rendered.as_deref().unwrap_or(&self.message)
    }

    fn all_spans(&self) -> impl Iterator<Item = &Span> {
        let below = self.children.iter().flat_map(|c| &c.spans);
        self.spans.iter().chain(below)
    }
}

fn is_numbered(code: &str) -> bool {
    let digits = code.strip_prefix('E').unwrap_or("");
    !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit())
}

fn level(name: &str) -> Level<'static> {
    match name {
        "error" => Level::ERROR,
        "warning" => Level::WARNING,
        "note" => Level::NOTE,
        "help" => Level::HELP,
        other => Level::ERROR.with_name(other.to_owned()),
    }
}

// Find the spots of a span
struct View<'a> {
    atlas: &'a Atlas,
    /// The whole diagnostic as rustc has it, without colours.
    rendered: &'a str,
}

struct Spot {
    path: String,
    text: Option<String>,
    range: Range<usize>,
    line: u32,
    column: u32,
}

impl View<'_> {
    /// The span itself, or the macro call that brings it into our files.
    fn nearest<'s>(&self, span: &'s Span) -> &'s Span {
        let ours = |span: &Span| {
            let path = Path::new(&span.file_name);
            path.is_relative() || self.atlas.find(path).is_some()
        };
        let mut called = span;
        while !ours(called) {
            match &called.expansion {
                Some(expansion) => called = &expansion.span,
                None => return span,
            }
        }
        called
    }

    // Turn a span into spots
    /// The tangled file of a span, if its positions can be trusted.
    fn tangled(&self, span: &Span) -> Option<&TangledFile> {
        let path = Path::new(&self.nearest(span).file_name);
        self.atlas.find(path).filter(|file| self.atlas.is_fresh(file))
    }

    fn spots(&self, span: &Span) -> Vec<Spot> {
        let tangled = self.tangled(span);
        let span = self.nearest(span);
        let ends = [
            (span.line_start, span.column_start),
            (span.line_end, span.column_end),
        ];
        let Some(file) = tangled else {
            return vec![self.other_spot(&span.file_name, ends)];
        };
        let stretches = self.atlas.stretches(file, ends).into_iter();
        let spot = |(chapter, range)| {
            Some(Spot::new(self.atlas.chapter(chapter)?, range))
        };
        stretches.filter_map(spot).collect()
    }

    fn other_spot(&self, path: &str, ends: [(u32, u32); 2]) -> Spot {
        let (line, column) = ends[0];
        let Some(source) = self.atlas.other(path) else {
            let path = path.to_owned();
            return Spot { path, text: None, range: 0..0, line, column };
        };
        let [from, to] = ends.map(|(line, column)| {
            let column = source.byte_column(line, column);
            source.offset(Place { file: 0, line, column })
        });
        Spot::new(&source, from..to.max(from))
    }
}

impl Spot {
    fn new(source: &Source, range: Range<usize>) -> Self {
        let shown = |bytes| String::from_utf8_lossy(bytes).into_owned();
        let offset = |end: usize| shown(&source.text[..end]).len();
        Self {
            path: shown(&source.name),
            text: Some(shown(&source.text)),
            range: offset(range.start)..offset(range.end),
            line: 0,
            column: 0,
        }
    }
}

// Draw the spots of a message
struct Mark {
    spot: Spot,
    primary: bool,
    label: Option<String>,
}

impl View<'_> {
    fn marks(&self, spans: &[Span]) -> Vec<Mark> {
        spans.iter().flat_map(|span| self.marks_of(span)).collect()
    }

    fn marks_of(&self, span: &Span) -> Vec<Mark> {
        let mut marks: Vec<Mark> = Vec::new();
        for spot in self.spots(span) {
            // See whether the stretch is above the first
            let above = marks.first().is_some_and(|first| {
                first.spot.path == spot.path
                    && first.spot.range.start > spot.range.start
            });
            let primary = span.is_primary && !above;
            marks.push(Mark { spot, primary, label: None });
        }
        if let Some(last) = marks.last_mut() {
            last.label = span.label.clone().filter(|l| !l.is_empty());
        }
        marks
    }
}

/// A group with the snippets that show some marks.
fn draw(mut group: Group<'static>, mut marks: Vec<Mark>) -> Group<'static> {
    marks.sort_by_key(|mark| !mark.primary);
    while let Some(mark) = marks.first() {
        let path = mark.spot.path.clone();
        let Some(text) = mark.spot.text.clone() else {
            group = draw_unreadable(group, marks.remove(0));
            continue;
        };
        let here = |mark: &mut Mark| mark.spot.path == path;
        let here = marks.extract_if(.., here).map(annotation);
        let here: Vec<Annotation> = here.collect();
        let snippet = Snippet::source(text).path(path);
        group = group.element(snippet.annotations(here));
    }
    group
}

fn annotation(mark: Mark) -> Annotation<'static> {
    let kind = match mark.primary {
        true => AnnotationKind::Primary,
        false => AnnotationKind::Context,
    };
    kind.span(mark.spot.range).label(mark.label)
}

/// The position of a mark whose text is not known, and its label.
fn draw_unreadable(group: Group<'static>, mark: Mark) -> Group<'static> {
    let Spot { path, line, column, .. } = mark.spot;
    let origin = Origin::path(path).line(line as usize);
    let group = group.element(origin.char_column(column as usize));
    match mark.label {
        Some(label) => group.element(Level::NOTE.message(label)),
        None => group,
    }
}

// Draw what the compiler proposes
#[derive(PartialEq)]
enum Role {
    Remark,
    Place,
    Hidden,
    Label,
    Proposal,
}

impl View<'_> {
    fn role(&self, child: &Message) -> Role {
        let plain = |s: &Span| s.suggested_replacement.is_none();
        if child.spans.is_empty() {
            return Role::Remark;
        } else if child.spans.iter().any(plain) {
            return Role::Place;
        }
        // Look for the proposal in the rendered text
        let first = child.message.lines().next().unwrap_or("");
        let text = format!("help: {first}");
        let mut lines = self.rendered.lines();
        match lines.find(|line| line.contains(&text)) {
            None => Role::Hidden,
            Some(line) if line.starts_with(&text) => Role::Proposal,
            Some(line) if line.trim_start().starts_with('=') => {
                Role::Remark
            }
            Some(_) => Role::Label,
        }
    }

    // Add the group of a child
    fn add_child(&self, child: &Message, groups: &mut Vec<Group<'static>>) {
        let role = self.role(child);
        let text = normalize_untrusted_str(&child.message);
        match role {
            Role::Hidden | Role::Label => return,
            Role::Remark => {
                if let Some(last) = groups.pop() {
                    let remark = level(&child.level).message(text);
                    groups.push(last.element(remark));
                }
                return;
            }
            Role::Place | Role::Proposal => (),
        }
        let title = level(&child.level).secondary_title(text);
        let group = Group::with_title(title);
        groups.push(match role {
            Role::Place => draw(group, self.marks(&child.spans)),
            _ => self.propose(group, child),
        });
    }

    // Make patches of a proposal
    /// A short proposal: its sentence and the new text.
    fn short_proposal(&self, child: &Message) -> String {
        let new = child.spans.iter().map(|span| self.replacement(span));
        let text = &child.message;
        match new.into_iter().find(|new| !new.is_empty()) {
            Some(new) => format!("help: {text}: `{new}`"),
            None => format!("help: {text}"),
        }
    }

    fn propose(
        &self,
        mut group: Group<'static>,
        child: &Message,
    ) -> Group<'static> {
        let alternatives = alternatives(&child.spans);
        let more = alternatives.len().saturating_sub(4);
        for parts in alternatives.iter().take(4) {
            // Draw one of the alternatives
            group = match self.patched(parts) {
                Some(snippets) => group.elements(snippets),
                None => group.elements(parts.iter().filter_map(|part| {
                    let new = part.suggested_replacement.as_deref()?;
                    let new = normalize_untrusted_str(new.trim());
                    Some(Level::HELP.no_name().message(format!("`{new}`")))
                })),
            };
        }
        if more > 0 {
            let text = format!("and {more} other candidates");
            group = group.element(Level::NOTE.no_name().message(text));
        }
        group
    }

    /// The snippets that show replacements, one for each file.
    fn patched(&self, parts: &[&Span]) -> Option<Vec<Proposed>> {
        let mut snippets: Vec<(String, Proposed)> = Vec::new();
        for part in parts {
            let spots = <[Spot; 1]>::try_from(self.spots(part)).ok()?;
            let [Spot { path, text, range, .. }] = spots;
            let patch = Patch::new(range, self.replacement(part));
            let known = snippets.iter().position(|(p, _)| *p == path);
            let snippet = match known {
                Some(index) => snippets.remove(index).1,
                None => Snippet::source(text?).path(path.clone()),
            };
            snippets.push((path, snippet.patch(patch)));
        }
        Some(snippets.into_iter().map(|(_, snippet)| snippet).collect())
    }

    /// The new text as it would stand in the chapter.
    fn replacement(&self, part: &Span) -> String {
        let new = part.suggested_replacement.as_deref().unwrap_or("");
        let Some(file) = self.tangled(part) else { return new.to_owned() };
        let line = self.nearest(part).line_start;
        let added = file.added_indentation(line);
        let cut = |line: &str| {
            let blank = line.len() - line.trim_start_matches(' ').len();
            line[blank.min(added)..].to_owned()
        };
        let mut lines = new.split('\n');
        let first = lines.next().unwrap_or("").to_owned();
        let lines = std::iter::once(first).chain(lines.map(cut));
        let lines: Vec<String> = lines.map(|l| escaped(&l)).collect();
        lines.join("\n")
    }
}

fn alternatives(spans: &[Span]) -> Vec<Vec<&Span>> {
    let start = |s: &Span| (s.line_start, s.column_start);
    let mut found: Vec<Vec<&Span>> = Vec::new();
    for span in spans {
        let same = |s: &&Span| start(s) == start(span);
        match found.last_mut() {
            Some(last) if !last.iter().any(same) => last.push(span),
            _ => found.push(vec![span]),
        }
    }
    found
}

fn escaped(line: &str) -> String {
    match line.rsplit_once(">>") {
        Some((before, after)) => {
            let before = before.replace("<<", "@<<");
            format!("{before}>>{after}")
        }
        None => line.to_owned(),
    }
}

type Proposed = Snippet<'static, Patch<'static>>;
