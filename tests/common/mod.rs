// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Running `pt` in a directory of its own, and looking at what it says.

// Each file of tests uses its own part of this module.
#![allow(dead_code)]

use std::fs;
use std::io::{self, Read, Write};
use std::os::unix::process::CommandExt;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use litpt::image::Image;
use litpt::scene::Mesh;
use tempfile::TempDir;

/// A floor, a wall and half a roof around the default camera, so that each
/// option of the camera and of the scene changes the image.
pub const ROOM: &str = "\
v -5 -5 -1\nv 5 -5 -1\nv 5 5 -1\nv -5 5 -1\nf 1 2 3 4\n\
v -2 4 -1\nv 1 4 -1\nv 1 4 1\nv -2 4 2\nf -4 -3 -2 -1\n\
v -1 0 1\nv 3 0 1\nv 3 6 1\nv -1 6 1\nf -4 -3 -2 -1\n";

/// A horizontal square, seen from above by `ABOVE`: each path meets it once
/// and then reaches the sky, so that the radiance is the albedo.
pub const SQUARE: &str = "\
v -1e6 -1e6 0\nv 1e6 -1e6 0\nv 1e6 1e6 0\nv -1e6 1e6 0\nf 1 2 3 4\n";

/// A closed box, in which a white path takes a thousand bounces.
pub const BOX: &str = "\
v -1 -1 -1\nv 1 -1 -1\nv 1 1 -1\nv -1 1 -1\n\
v -1 -1 1\nv 1 -1 1\nv 1 1 1\nv -1 1 1\n\
f 1 2 3 4\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

/// The camera that sees nothing but the `SQUARE`.
pub const ABOVE: [&str; 4] = ["-p0,0,2", "-t0,0,0", "-u0,0.1,1", "-F40"];

/// The program, of this package or that of many processes.
const PT: &str = match (
    option_env!("CARGO_BIN_EXE_pt"),
    option_env!("CARGO_BIN_EXE_pt-mpi"),
) {
    (Some(program), _) | (_, Some(program)) => program,
    _ => "pt",
};

/// Its companion, which is not in the package of many processes.
const PTIMG: &str = match option_env!("CARGO_BIN_EXE_ptimg") {
    Some(program) => program,
    None => "ptimg",
};

/// No run of these tests takes longer, unless it hangs.
const PATIENCE: Duration = Duration::from_secs(120);

/// A directory that holds `room.obj` and `square.obj`, and nothing else.
pub struct Scratch(TempDir);

impl Scratch {
    pub fn new() -> Self {
        let place = Self(tempfile::tempdir().unwrap());
        place.put("room.obj", ROOM);
        place.put("square.obj", SQUARE);
        place
    }

    /// The same with another file.
    pub fn with(name: &str, bytes: impl AsRef<[u8]>) -> Self {
        let place = Self::new();
        place.put(name, bytes);
        place
    }

    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    pub fn put(&self, name: &str, bytes: impl AsRef<[u8]>) {
        fs::write(self.path(name), bytes).unwrap();
    }

    /// A file of JSON.
    pub fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&self.get(name)).unwrap()
    }

    pub fn get(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap()
    }

    pub fn text(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).unwrap()
    }

    /// The names of what is there, in alphabetical order.
    pub fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(self.0.path()).unwrap();
        let name = |e: fs::DirEntry| e.file_name().into_string().unwrap();
        let mut names: Vec<_> = entries.map(|e| name(e.unwrap())).collect();
        names.sort();
        names
    }

    /// What a failed run must leave: the scenes and `others` alone.
    pub fn holds_only(&self, others: &[&str]) {
        let mut expected = vec!["room.obj", "square.obj"];
        expected.extend(others);
        expected.sort();
        assert_eq!(self.names(), expected);
    }

    /// The command `program` here, with pipes at its three ends; `$PT` and
    /// `$PTIMG` are the programs.
    pub fn command(&self, program: &str) -> Command {
        let mut command = Command::new(program);
        command.current_dir(self.0.path());
        command.env_remove("NO_COLOR").env_remove("CLICOLOR_FORCE");
        command.env("RUST_BACKTRACE", "0").env("TERM", "xterm");
        command.env("PT", PT).env("PTIMG", PTIMG);
        command.stdin(Stdio::null());
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        // SAFETY: a signal handler may call what is called here.
        unsafe { command.pre_exec(shed_what_is_inherited) };
        command
    }

    /// The command `pt` with the camera at the origin, as the reference
    /// has it, unless the words of the line say otherwise.
    pub fn pt(&self, line: &str) -> Command {
        let mut command = self.command(PT);
        command.arg("-p0,0,0").args(line.split_whitespace());
        command
    }

    /// Runs `pt` with the words of a line.
    pub fn line(&self, line: &str) -> Run {
        outcome(&mut self.pt(line))
    }

    /// Runs `pt` with the words of a line, and no camera.
    pub fn free(&self, line: &str) -> Run {
        outcome(self.command(PT).args(line.split_whitespace()))
    }

    /// Runs `pt` with the words of a line, which is a success.
    #[track_caller]
    pub fn done(&self, line: &str) -> Run {
        self.line(line).succeeded()
    }

    /// Runs `pt` under a limit of the shell.
    pub fn within(&self, limit: &str, arguments: &str) -> Run {
        let pt = format!("exec \"$PT\" -p0,0,0 {arguments}");
        self.shell(&format!("ulimit {limit}; {pt}"))
    }

    /// Runs a script of the shell.
    pub fn shell(&self, script: &str) -> Run {
        outcome(self.command("sh").args(["-c", script]))
    }

    /// The command `ptimg` with the words of a line.
    pub fn companion(&self, line: &str) -> Command {
        let mut command = self.command(PTIMG);
        command.args(line.split_whitespace());
        command
    }

    /// Runs `ptimg` to its end.
    pub fn ptimg(&self, line: &str) -> Run {
        outcome(&mut self.companion(line))
    }

    /// Runs `pt` with `input` on its standard input.
    pub fn feed(&self, input: &[u8], line: &str) -> Run {
        feed(self.pt(line), input)
    }

    /// The image of a file.
    pub fn image(&self, name: &str) -> Image {
        Image::read(&self.path(name)).unwrap()
    }

    /// The image of the scene `room.obj` on standard output.
    pub fn render(&self, arguments: &str) -> Vec<u8> {
        let run = self.done(&format!("-iroom.obj {arguments}"));
        assert!(!run.stdout.is_empty());
        run.stdout
    }
}

/// How a run ended.
#[derive(Debug)]
pub struct Run {
    pub status: Option<i32>,
    pub stdout: Vec<u8>,
    pub stderr: String,
}

/// A child that does not outlive its test, however that ends.
pub struct Running(pub Child);

impl Running {
    /// The number of its process.
    pub fn id(&self) -> u32 {
        self.0.id()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Neither does anything to a child that has been waited for.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Called in a child: no signal is ignored there because somebody has started
/// the tests so (nohup, a script's job), and Linux kills it when the thread
/// that has started it ends. That is the thread of its test.
fn shed_what_is_inherited() -> io::Result<()> {
    use libc::*;
    let signals = [SIGHUP, SIGINT, SIGQUIT, SIGTERM, SIGUSR1, SIGUSR2];
    for signal in signals.into_iter().chain([SIGXCPU, SIGXFSZ]) {
        // SAFETY: it has no other threads.
        unsafe { libc::signal(signal, SIG_DFL) };
    }
    #[cfg(target_os = "linux")]
    // SAFETY: it touches no memory.
    unsafe {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
    }
    Ok(())
}

/// Starts a command.
pub fn spawn(command: &mut Command) -> Running {
    Running(command.spawn().unwrap())
}

/// Runs a command to its end.
pub fn outcome(command: &mut Command) -> Run {
    finish(spawn(command))
}

/// Runs a command with `input` on its standard input.
pub fn feed(mut command: Command, input: &[u8]) -> Run {
    let mut child = spawn(command.stdin(Stdio::piped()));
    // One that has ended does not read it.
    let _ = child.0.stdin.take().unwrap().write_all(input);
    finish(child)
}

/// Waits for a child and collects what it wrote.
pub fn finish(mut child: Running) -> Run {
    drop(child.0.stdin.take());
    let stdout = collect(child.0.stdout.take());
    let stderr = collect(child.0.stderr.take());
    let start = Instant::now();
    let status = loop {
        if let Some(status) = child.0.try_wait().unwrap() {
            break status;
        }
        assert!(start.elapsed() < PATIENCE, "no end in {PATIENCE:?}");
        thread::sleep(Duration::from_millis(1));
    };
    let stderr = String::from_utf8(stderr.join().unwrap()).unwrap();
    let stdout = stdout.join().unwrap();
    Run { status: status.code(), stdout, stderr }
}

fn collect(
    from: Option<impl Read + Send + 'static>,
) -> thread::JoinHandle<Vec<u8>> {
    thread::spawn(move || {
        let mut bytes = vec![];
        if let Some(mut from) = from {
            from.read_to_end(&mut bytes).unwrap();
        }
        bytes
    })
}

/// Starts a command that reads a scene, and returns when it has begun.
pub fn keep_reading(mut command: Command) -> Running {
    let mut child = spawn(command.stdin(Stdio::piped()));
    // More than any pipe holds: the write ends when somebody reads.
    let comment = "# nothing to see here, read on\n".repeat(1 << 16);
    child.0.stdin.as_mut().unwrap().write_all(comment.as_bytes()).unwrap();
    child
}

/// Waits until a running program has come as far as the test needs it.
pub fn wait_until(
    child: &mut Running,
    what: &str,
    done: impl Fn() -> bool,
) {
    let start = Instant::now();
    while !done() {
        assert!(child.0.try_wait().unwrap().is_none(), "ended, no {what}");
        assert!(start.elapsed() < PATIENCE, "no {what}");
        thread::sleep(Duration::from_millis(1));
    }
}

/// Whether a process of this number is there, on Linux.
pub fn is_running(process: u32) -> bool {
    fs::read_link(format!("/proc/{process}/exe")).is_ok()
}

/// Sends a signal, which fails if the program has ended.
pub fn signal(name: &str, process: u32) {
    let mut command = Command::new("kill");
    command.args([format!("-{name}"), process.to_string()]);
    command.stderr(Stdio::null()).status().unwrap();
}

impl Run {
    /// What is on standard output.
    pub fn text(self) -> String {
        String::from_utf8(self.stdout).unwrap()
    }

    /// Ended with 0 and without an error.
    #[track_caller]
    pub fn succeeded(self) -> Self {
        assert_eq!(self.status, Some(0), "{}", self.stderr);
        assert!(!self.stderr.contains("error:"), "{}", self.stderr);
        self
    }

    /// Has said each of the `words` on standard error.
    #[track_caller]
    pub fn told<S: AsRef<str>>(&self, words: &[S]) {
        says(&self.stderr, words);
    }

    /// Ended with `status`, nothing on standard output, and one line on
    /// standard error that begins `error:` and holds each of the `words`.
    #[track_caller]
    pub fn failed(&self, status: i32, words: &[&str]) {
        let stderr = &self.stderr;
        assert_eq!(self.status, Some(status), "{stderr}");
        assert!(self.stdout.is_empty(), "{:?}", self.stdout);
        assert!(stderr.starts_with("error: "), "{stderr}");
        assert!(stderr.ends_with('\n'), "{stderr}");
        assert_eq!(stderr.lines().count(), 1, "{stderr}");
        says(stderr, words);
    }
}

/// Demands that a text has each of the `words`.
#[track_caller]
pub fn says<S: AsRef<str>>(text: &str, words: &[S]) {
    for word in words.iter().map(AsRef::as_ref) {
        assert!(text.contains(word), "no {word} in: {text}");
    }
}

/// A mesh as OBJ.
pub fn obj(mesh: &Mesh) -> String {
    let vertices = mesh.vertices.iter();
    let vertices = vertices.map(|p| format!("v {} {} {}\n", p.x, p.y, p.z));
    let faces = mesh.triangles.iter().map(|face| {
        let [a, b, c] = face.map(|i| i + 1);
        format!("f {a} {b} {c}\n")
    });
    vertices.chain(faces).collect()
}

/// The width, the height and the levels of a plain PGM; the form is exact.
pub fn pgm(bytes: &[u8]) -> (u32, u32, Vec<u16>) {
    let text = std::str::from_utf8(bytes).unwrap();
    assert!(text.ends_with('\n'));
    let mut lines = text.lines();
    let size = lines.next().unwrap().strip_prefix("P2 ").unwrap();
    let (width, height) = size.split_once(' ').unwrap();
    assert_eq!(lines.next(), Some("255"));
    let levels = lines.map(|line| {
        let level: u8 = line.parse().unwrap();
        assert_eq!(line, level.to_string());
        level.into()
    });
    (width.parse().unwrap(), height.parse().unwrap(), levels.collect())
}

/// Says why this test, or a part of it, could not be made here: past the
/// capture of its output, so that .ci/run sees whether such tests become more.
pub fn skip(why: &str) {
    let thread = thread::current();
    let line =
        format!("skipped: {}: {why}\n", thread.name().unwrap_or("?"));
    io::stderr().write_all(line.as_bytes()).unwrap();
}
