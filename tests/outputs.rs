// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! Where `pt` puts the image, what its bytes are, and that no accident
//! loses a file.

use crate::prelude::*;

use crate::extremes::sized;
use crate::formats::{bytes, decode};

use std::ffi::CString;
use std::fs::{File, OpenOptions};
use std::io::{BufRead, BufReader, Read};
use std::os::fd::AsRawFd;
use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};

const SMALL: &str = "-iroom.obj -d9x7 -n2";

fn write(place: &Scratch, output: &str) -> Run {
    place.line(&format!("{SMALL} {output}"))
}

/// Puts an old file with an old date, which no failed run may change.
fn put_old(place: &Scratch, name: &str) -> SystemTime {
    place.put(name, "old");
    let date = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
    let file = OpenOptions::new().write(true).open(place.path(name));
    file.unwrap().set_modified(date).unwrap();
    date
}

fn modified(place: &Scratch, name: &str) -> SystemTime {
    fs::metadata(place.path(name)).unwrap().modified().unwrap()
}

/// Starts `pt` and returns when it has begun to read its scene.
fn start_reading(place: &Scratch, arguments: &str) -> Running {
    keep_reading(place.pt(&format!("-d9x7 {arguments}")))
}

fn send_room(mut child: Running) -> Run {
    child.0.stdin.as_mut().unwrap().write_all(ROOM.as_bytes()).unwrap();
    finish(child)
}

/// The name and the fault are told before the scene is read, and nothing is
/// written.
#[test]
fn what_cannot_be_done_is_told_at_once() {
    let place = Scratch::new();
    place.done("room.obj -d23x17 -q -otruth.exr -otruth.pfm -olevels.png");
    let (exr, mut nan) = (place.get("truth.exr"), place.get("truth.pfm"));
    let end = nan.len();
    nan[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    place.put("nan.pfm", nan);
    let header = format!("Pf\n2 2\n{}\n", "\u{e9}\u{1b}".repeat(5000));
    place.put("long.pfm", header);
    place.put("short.exr", &exr[..exr.len() / 2]);
    let date = put_old(&place, "old.png");
    put_old(&place, "r.json");
    put_old(&place, "c");
    fs::create_dir(place.path("folder.pgm")).unwrap();
    symlink("nothing.pgm", place.path("nowhere.pgm")).unwrap();
    symlink("room.obj", place.path("link.pgm")).unwrap();
    let names = place.names();
    let long = ["n".repeat(252), ".pgm".to_owned()].concat();
    let long = format!("-o {long}");
    let size = "is 23x17 pixels large, and the image 17x23";
    let with_force = [
        (&*long, "File name too long"),
        ("-o none/image.pgm", "none/image.pgm: cannot create a file"),
        ("-o room.obj/image.pgm", "room.obj/image.pgm: cannot write: Not"),
        ("-o folder.pgm", "folder.pgm: is a directory"),
        ("-o .", ".: is a directory"),
        ("-o /", "/: is a directory"),
        ("-o image.jpg", ".pgm, .png"),
        ("-o image.pgm.gz", ".pgm, .png"),
        ("-o image.pgmx", ".pgm, .png"),
        ("-o nowhere.pgm", "nowhere.pgm: dangling symbolic link"),
        ("-o first.pgm", "first.pgm: this file is named twice"),
        ("--report r", ".json, .csv or .html"),
        ("--report r.json.gz", ".json, .csv or .html"),
        // No file may serve two purposes.
        ("--report=s.json --report=s.json", "s.json: this file is named"),
        ("-os.exr --checkpoint=s.exr", "s.exr: this file is named twice"),
        ("--reference=s.pfm -os.pfm", "s.pfm: this file is named twice"),
        ("--checkpoint=./s.json --report=s.json", "this file is named"),
        ("-os.exr --checkpoint=.//s.exr", "this file is named twice"),
        ("room.obj -olink.pgm", "link.pgm: this file is named twice"),
        ("room.obj --checkpoint=room.obj", "room.obj: this file is named"),
        // References and cameras.
        ("--reference=truth.exr -d17x23", size),
        ("--reference=truth.pfm -d17x23", size),
        ("--reference=short.exr -d23x17", "short.exr"),
        ("--reference=nan.pfm -d23x17", "numbers: 1, the first at 22,0"),
        ("--reference=levels.png -d23x17", "grey levels"),
        ("--reference=none.exr -d23x17", "none.exr: cannot read"),
        ("--reference=long.pfm -d23x17", "its header has a scale of"),
        ("-p1,2.5,-3 -t1,2.5,-3", "1,2.5,-3"),
        ("-t1,2,-3 -u-2,-4,6", "1,2,-3"),
    ];
    let exists = "the file exists; overwrite it with -f";
    let old = ["-o old.png", "--report r.json", "--checkpoint c"];
    let all = ["-q", "-f"].map(|force| with_force.map(|row| (row, force)));
    let old = old.map(|words| ((words, exists), "-q"));
    for ((words, fault), force) in all.concat().into_iter().chain(old) {
        let scene =
            if words.contains("room.obj ") { "" } else { "missing.obj" };
        let files = format!("{scene} -o first.pgm {words} {force}");
        let run = place.line(&files);
        let is_odd = ["-p1", "-t1"].iter().any(|it| words.starts_with(it));
        let is_odd =
            is_odd || fault.contains(".png") || fault.contains(".csv");
        let status = if is_odd { 2 } else { 1 };
        run.failed(status, &[fault]);
        assert!(!run.stderr.contains('\u{1b}'), "{}", run.stderr);
        assert!(!run.stderr.contains(".pt-"), "{}", run.stderr);
        assert!(run.stderr.chars().count() < 400, "{}", run.stderr);
    }
    assert_eq!(place.names(), names);
    assert_eq!(place.text("room.obj"), ROOM);
    assert_eq!(place.get("old.png"), b"old");
    assert_eq!(modified(&place, "old.png"), date);
}

/// What is finished is beside it then, under the name that is said.
#[test]
fn a_file_created_meanwhile_is_left_untouched_without_force() {
    let long = ["n".repeat(251), ".pgm".to_owned()].concat();
    for image in ["image.pgm", &long] {
        let place = Scratch::new();
        let target = OutputTarget::file(&place.path(image), false).unwrap();
        place.holds_only(&[]);
        let date = put_old(&place, image);
        let told = target.write(&mut |out| out.write_all(b"new"));
        let told = told.unwrap_err().to_string();
        assert!(told.contains(image) && told.contains("-f"), "{told}");
        assert_eq!(place.get(image), b"old");
        assert_eq!(modified(&place, image), date);
        let names = place.names();
        let start = if image.len() < 243 { "kept-" } else { ".pt-" };
        let kept = names.iter().find(|name| name.starts_with(start));
        let kept = kept.unwrap();
        place.holds_only(&[kept, image]);
        assert!(told.contains("kept as ") && told.contains(kept));
        assert!(kept.ends_with("-image.pgm") || start == ".pt-");
        assert_eq!(place.get(kept), b"new");
    }
}

#[test]
fn an_image_whose_directory_disappears_is_kept_elsewhere() {
    let place = Scratch::new();
    for directory in ["gone", "temporary"] {
        fs::create_dir(place.path(directory)).unwrap();
    }
    let mut command = place.pt("-d9x7 -n2 -ogone/image.pgm");
    command.env("TMPDIR", place.path("temporary"));
    let child = keep_reading(command);
    fs::remove_dir(place.path("gone")).unwrap();
    let run = send_room(child);
    run.failed(1, &["gone/image.pgm", "No such file", "kept as "]);
    let kept = fs::read_dir(place.path("temporary")).unwrap();
    let kept: Vec<_> = kept.map(|entry| entry.unwrap().path()).collect();
    assert_eq!(kept.len(), 1);
    assert!(run.stderr.contains(kept[0].to_str().unwrap()));
    assert_eq!(fs::read(&kept[0]).unwrap(), place.render(SMALL));
}

#[test]
fn an_image_appears_only_when_it_is_whole() {
    let place = Scratch::new();
    put_old(&place, "old.pgm");
    let output = "-f -oold.pgm -onew.png";
    let mut child = start_reading(&place, output);
    assert_eq!(place.get("old.pgm"), b"old");
    child.0.kill().unwrap();
    finish(child);
    assert_eq!(place.get("old.pgm"), b"old");
    place.holds_only(&["old.pgm"]);
    // A file created during the render is replaced with force.
    let child = start_reading(&place, output);
    put_old(&place, "new.png");
    send_room(child).succeeded();
    assert_eq!(pgm(&place.get("old.pgm")).2.len(), 63);
    assert_eq!(png(&place.get("new.png")).2.len(), 63);
    place.holds_only(&["old.pgm", "new.png"]);
}

#[test]
fn a_directory_that_is_closed_to_us_is_reported_at_once() {
    let place = Scratch::new();
    let closed = place.path("closed");
    fs::create_dir(&closed).unwrap();
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o555))
        .unwrap();
    let mut directory = closed.as_path();
    if File::create(closed.join("probe")).is_ok() {
        // This user may write everywhere, except where nobody may.
        directory = Path::new("/proc");
        if !directory.exists() {
            return skip("there is no directory closed to this user");
        }
    }
    let film = directory.join("image.pgm");
    for force in [false, true] {
        let fault =
            OutputTarget::file(&film, force).unwrap_err().to_string();
        assert!(fault.starts_with(&*film.to_string_lossy()), "{fault}");
    }
}

/// The device `null` or `full`. Where this user could lose the system's
/// own if `pt` were to replace it, a new one of the same kind.
fn device(place: &Scratch, name: &str) -> Option<String> {
    let system = format!("/dev/{name}");
    let probe = tempfile::tempfile_in("/dev");
    let own = place.path(name).display().to_string();
    let path = if probe.is_err() { system } else { own };
    if probe.is_ok() {
        let minor = if name == "null" { "3" } else { "7" };
        let mut command = place.command("mknod");
        command.args([&path, "c", "1", minor]);
        finish(Running(command.spawn().ok()?));
    }
    let there = OpenOptions::new().write(true).open(&path).is_ok();
    if !there {
        skip(&format!("there is no device {name}"));
    }
    there.then_some(path)
}

#[test]
fn a_device_needs_no_force_and_stays_a_device() {
    let place = Scratch::new();
    let Some(null) = device(&place, "null") else { return };
    let Some(full) = device(&place, "full") else { return };
    for force in ["-q", "-f"] {
        write(&place, &format!("-o {null} {force}")).succeeded();
        let run = write(&place, &format!("-o {full} -oa.pgm -f"));
        run.failed(1, &["full: ", "No space left"]);
        assert_eq!(place.get("a.pgm"), place.render(SMALL));
    }
    for path in [&null, &full] {
        assert!(fs::metadata(path).unwrap().file_type().is_char_device());
    }
    for words in [&format!("{SMALL} -o-"), "--help"] {
        let full = OpenOptions::new().write(true).open(&full);
        let mut command = place.pt(words);
        let run = outcome(command.stdout(full.unwrap()));
        run.failed(1, &["standard output: cannot write: No space left"]);
    }
}

#[test]
fn a_named_pipe_carries_the_image_and_stays_a_pipe() {
    let place = Scratch::new();
    let pipe = place.path("pipe.pgm");
    let name = CString::new(pipe.as_os_str().as_bytes()).unwrap();
    // SAFETY: the name is one, and ends with zero.
    assert_eq!(unsafe { libc::mkfifo(name.as_ptr(), 0o600) }, 0);
    let path = pipe.clone();
    let reader = thread::spawn(move || fs::read(path).unwrap());
    let target = OutputTarget::file(&pipe, false).unwrap();
    target.write(&mut |out| out.write_all(b"image")).unwrap();
    assert!(fs::metadata(&pipe).unwrap().file_type().is_fifo());
    assert_eq!(reader.join().unwrap(), b"image");
}

/// Runs a script of the shell, in which `pt` renders the room.
fn shell(place: &Scratch, script: &str) -> Run {
    const PROGRAMS: &str = r#"
        pt() { "$PT" -q -p0,0,0 -i room.obj -d9x7 -n2 "$@"; }
        noisy() { "$PT" -q -p0,0,0 -i room.obj -d512x384 -n3 "$@"; }
        ptimg() { "$PTIMG" "$@"; }
    "#;
    place.shell(&[PROGRAMS, script].concat())
}

/// The shell's log keeps what is before the image and gets what is after.
#[test]
fn what_the_shell_has_opened_is_written_and_not_replaced() {
    let place = Scratch::new();
    shell(&place, "pt -o a.pgm -o a.exr").succeeded();
    let image = place.text("a.pgm");
    symlink("/proc/self/fd/1", place.path("link")).unwrap();
    for name in ["-", "/dev/stdout", "/dev/fd/1", "/proc/self/fd/1", "link"]
    {
        for command in [
            "pt -o",
            "pt -f -o",
            "pt -f --format=pgm -o",
            "ptimg tonemap a.exr -o",
            "ptimg tonemap a.exr --format=pgm -fo",
        ] {
            let command = format!("{command} {name}");
            let group = format!("{{ echo 1; {command}; echo 2; }} > log");
            shell(&place, &group).succeeded();
            let once = format!("1\n{image}2\n");
            assert!(place.text("log") == once, "{command}");
            shell(&place, &format!("{command} >> log")).succeeded();
            let both = once + &image;
            assert!(place.text("log") == both, "{command}");
        }
    }
    for values in ["--faces", "--faces --view-factors=faces"] {
        let run = |name| {
            let command = format!("$PT room.obj -qn2 {values} -o {name}");
            place.shell(&command).succeeded().stdout
        };
        let table = run("-");
        assert!(!table.is_empty() && table == run("/dev/stdout"));
    }
    // So are descriptors of other numbers.
    let files = "-o /dev/fd/5 --report /dev/fd/3 --checkpoint /dev/fd/4";
    let run = format!("pt {files} 5>&1 3>> log 4> c | cat > b.pgm");
    shell(&place, &run).succeeded();
    assert!(place.text("b.pgm") == image);
    let log = place.text("log");
    let (_, report) = log.split_once('{').unwrap();
    assert!(log.starts_with("1\n") && report.contains("\"curve\""));
    let on = place.line("--resume=c -o- --report=r.json --checkpoint=d");
    assert!(on.stdout == image.as_bytes());
    // What cannot be written is refused before the scene is read.
    for (closed, fault) in [
        ("/dev/fd/3 3< a.pgm", "/dev/fd/3: not open for writing"),
        ("/dev/fd/7", "/dev/fd/7: "),
        ("- < a.pgm 1<&0", "standard output: not open for writing"),
    ] {
        let run = format!("pt -f -i none.obj -o {closed}");
        shell(&place, &run).failed(1, &[fault]);
    }
}

#[test]
fn a_closed_standard_output_is_an_error_if_it_is_wanted() {
    let place = Scratch::new();
    let files = "pt -o a.exr; pt -s1 -o b.exr; \
                 pt -n2 --samples 0..1 -o a.litpt; \
                 pt -n2 --samples 1..2 -o b.litpt";
    shell(&place, files).succeeded();
    let wanted = "pt|pt --format=exr -o -|pt -o /dev/stdout|pt --explain|\
                  pt --help|pt --version|pt -o c.pgm --report -|\
                  ptimg --help|ptimg info a.exr|ptimg tonemap a.exr -o -|\
                  ptimg stderr a.exr -fo c.pgm|ptimg diff a.exr b.exr|\
                  ptimg merge a.litpt b.litpt -o -";
    for command in wanted.split('|') {
        for others in ["", "<&-", "2>err <&-"] {
            let run = shell(&place, &format!("{command} >&- {others}"));
            assert!(run.status > Some(0), "{command}: {}", run.stderr);
        }
        let said = place.text("err");
        let fault = "standard output: not open for writing";
        assert!(said.contains(fault), "{command}: {said}");
    }
    // It concerns nobody else, and neither do the other two.
    shell(&place, "pt -fo c.pgm >&-").succeeded();
    shell(&place, "pt -fo d.pgm >&- 2>&- <&-").succeeded();
    assert!(place.get("c.pgm") == place.get("d.pgm"));
    shell(&place, "pt > /dev/null && pt 1<> /dev/null").succeeded();
}

#[test]
fn an_output_that_does_not_block_gets_all_bytes() {
    let place = Scratch::new();
    let image = "-iroom.obj -d300x200 --format=pfm";
    let whole = place.line(image).stdout;
    let (mut reader, writer) = io::pipe().unwrap();
    let fd = writer.as_raw_fd();
    // SAFETY: the descriptor is open.
    let done = unsafe { libc::fcntl(fd, libc::F_SETFL, libc::O_NONBLOCK) };
    assert_eq!(done, 0);
    let child = spawn(place.pt(image).stdout(writer));
    thread::sleep(Duration::from_millis(500));
    let mut bytes = vec![];
    reader.read_to_end(&mut bytes).unwrap();
    finish(child).succeeded();
    assert!(bytes == whole, "{} of {} bytes", bytes.len(), whole.len());
}

#[test]
fn a_write_that_stops_half_way_leaves_the_old_file_whole() {
    let place = Scratch::new();
    let date = put_old(&place, "old.pgm");
    for output in ["-foold.pgm", "-onew.pgm", "-onew.png"] {
        // The noise needs more than 64 blocks in each format.
        let run = shell(&place, &format!("ulimit -f 64; noisy {output}"));
        run.failed(1, &["cannot write", "File too large"]);
        assert!(!run.stderr.contains(".pt-"), "{}", run.stderr);
        assert_eq!(place.get("old.pgm"), b"old");
        assert_eq!(modified(&place, "old.pgm"), date);
        place.holds_only(&["old.pgm"]);
    }
    // Each file that cannot be written is named.
    let run = shell(&place, "ulimit -f 64; noisy -oa.pgm -ob.pfm");
    run.failed(1, &["a.pgm", "b.pfm"]);
    shell(&place, "noisy -o a.exr").succeeded();
    let run = shell(&place, "ulimit -f 1; ptimg tonemap a.exr -o a.png");
    run.failed(1, &["a.png: cannot write: File too large"]);
    place.holds_only(&["a.exr", "old.pgm"]);
}

#[test]
fn a_reader_who_has_seen_enough_is_no_error() {
    let place = Scratch::new();
    let mut child = spawn(&mut place.pt("-q -iroom.obj"));
    let mut line = String::new();
    let mut reader = BufReader::new(child.0.stdout.take().unwrap());
    reader.read_line(&mut line).unwrap();
    drop(reader);
    let run = finish(child);
    assert_eq!(line, "P2 320 240\n");
    assert_eq!((run.status, run.stderr.as_str()), (Some(0), ""));
    // Or has seen nothing, of either program.
    place.done("-iroom.obj -d9x7 -oa.exr");
    for mut command in [place.pt("-h"), place.companion("info a.exr")] {
        let (reader, writer) = io::pipe().unwrap();
        drop(reader);
        let run = outcome(command.stdout(writer));
        assert_eq!((run.status, run.stderr.as_str()), (Some(0), ""));
    }
}

#[test]
fn force_replaces_the_file_behind_a_link_and_keeps_the_link() {
    let place = Scratch::new();
    fs::create_dir(place.path("far")).unwrap();
    put_old(&place, "far/image.pgm");
    let link = place.path("link.pgm");
    symlink("far/image.pgm", &link).unwrap();
    let refused = OutputTarget::file(&link, false).unwrap_err().to_string();
    assert!(refused.contains("link.pgm") && refused.contains("-f"));
    let target = OutputTarget::file(&link, true).unwrap();
    assert_eq!(place.get("far/image.pgm"), b"old");
    target.write(&mut |out| out.write_all(b"new")).unwrap();
    assert_eq!(fs::read_link(link).unwrap(), Path::new("far/image.pgm"));
    assert_eq!(place.get("far/image.pgm"), b"new");
    place.holds_only(&["far", "link.pgm"]);
}

/// The kind of the pixels of a PNG, its width and height, and its levels,
/// which have 16 bits.
pub fn png(bytes: &[u8]) -> (png::ColorType, (u32, u32), Vec<u16>) {
    let decoder = png::Decoder::new(Cursor::new(bytes));
    let mut reader = decoder.read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    assert_eq!(info.bit_depth, png::BitDepth::Sixteen);
    assert!(reader.info().srgb.is_some());
    let levels = bytes.as_chunks().0.iter();
    let levels = levels.map(|&pair| u16::from_be_bytes(pair)).collect();
    (info.color_type, (info.width, info.height), levels)
}

#[test]
fn the_rows_go_from_top_to_bottom_and_from_left_to_right() {
    // A wall hides the sky on the left, the ground on the right is dark.
    let wall = "v -9 1 -9\nv 0 1 -9\nv 0 1 9\nv -9 1 9\nf 1 2 3 4\n";
    let mesh = read_obj(wall.as_bytes()).unwrap();
    let view = look(DVec3::ZERO, 9. * DVec3::Y, 20.);
    let view = View { up: DVec3::Z, ..view };
    let film = sized(&mesh, &view, 0., (2, 2), 4, 0);
    assert_eq!(film.means().collect::<Vec<_>>(), [0., 1., 0., 0.]);
    let image = Image::plain(2, 2, film.means().collect());
    for format in [Format::Pgm, Format::Png] {
        let read = decode(&bytes(format, &image)).unwrap();
        assert_eq!(read.means, image.means);
    }
}

#[test]
fn a_level_is_the_floor_of_the_srgb_curve() {
    for rho in [0., 0.001, 0.0031, 0.0032, 0.05, 0.1, 0.5, 0.9, 1.] {
        let image = Image::plain(1, 1, vec![rho]);
        let [coarse, fine] =
            [Format::Pgm, Format::Png].map(|format| bytes(format, &image));
        let curve = match rho <= 0.0031308 {
            true => 12.92 * rho,
            false => 1.055 * f64::powf(rho, 1. / 2.4) - 0.055,
        };
        let level = |most: f64| vec![(most * curve + 1e-9).floor() as u16];
        assert_eq!(pgm(&coarse).2, level(255.), "{rho}");
        let grey = (png::ColorType::Grayscale, (1, 1), level(65535.));
        assert_eq!(png(&fine), grey, "{rho}");
    }
}
