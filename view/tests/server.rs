// Copyright (C) 2026 litpt contributors
// SPDX-License-Identifier: GPL-3.0-or-later

//! What `ptview` answers, and whom it does not wait for.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// A ptview that may open a hundred files, its host, and the secret.
struct Server(Child, String, String);

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.0.kill().and_then(|()| self.0.wait());
    }
}

fn start() -> Server {
    let line =
        "ulimit -n 100; unset DISPLAY WAYLAND_DISPLAY; exec $0 $1 2>&-";
    let scene = "../doc/examples/room.obj";
    let mut command = Command::new("sh");
    command.args(["-c", line, env!("CARGO_BIN_EXE_ptview"), scene]);
    let mut child = command.stdout(Stdio::piped()).spawn().unwrap();
    let out = BufReader::new(child.stdout.take().unwrap());
    let address = out.lines().next().unwrap().unwrap();
    let (host, token) = address[7..].split_once('/').unwrap();
    Server(child, host.to_owned(), token.replace('/', ""))
}

impl Server {
    /// Sends a part of a request in Latin-1: @ is the host, $ the secret, and
    /// | a new line.
    fn send(&self, text: &str) -> TcpStream {
        let text = text.replace('|', "\r\n").replace('@', &self.1);
        let text = text.replace('$', &self.2);
        let bytes = text.chars().map(|c| c as u8).collect::<Vec<_>>();
        let mut stream = TcpStream::connect(&self.1).unwrap();
        let patience = Some(Duration::from_secs(9));
        stream.set_read_timeout(patience).unwrap();
        stream.write_all(&bytes).unwrap();
        stream
    }

    /// The answer, after which the connection ends.
    fn ask(&self, text: &str) -> String {
        let mut answer = String::new();
        self.send(text).read_to_string(&mut answer).unwrap();
        answer.to_lowercase()
    }
}

#[test]
fn each_request_is_answered_as_the_standard_has_it_and_no_other_follows() {
    let server = start();
    for (request, status) in [
        ("GET /$/view.css HTTP/1.0|Host: @|", "200"),
        ("GET /$/ HTTP/1.1|Host: @|X-Name: Zo\u{eb}|", "200"),
        ("GET http://@/$/ HTTP/1.1|Host: @|", "200"),
        ("GET http://a.example/$/ HTTP/1.1|Host: @|", "404"),
        ("GET /$/ HTTP/1.1|Host: \u{eb}|", "404"),
        ("GET /$/ HTTP/1.1|Host: @|Host: @|", "400"),
        ("GET /$/ HTTP/1.1|", "400"),
        ("GET /$/%2e%2e%2flog HTTP/1.1|Host: @|", "404"),
        ("BREW /$/ HTTP/1.1|Host: @|", "405"),
        ("POST /$/set HTTP/1.1|Host: @|Content-Length: 2||{]", "400"),
    ] {
        let answer = server.ask(&format!("{request}|"));
        assert_eq!(&answer[9..12], status, "{request}: {answer}");
        assert_eq!(status == "405", answer.contains("\nallow: "));
    }
    for name in ["", "view.css", "view.js", "stream", "nothing", "set"] {
        let head = format!("HEAD /$/{name} HTTP/1.1|Host: @||");
        assert!(server.ask(&head).ends_with("\r\n\r\n"), "{name}");
    }
}

#[test]
fn silent_and_slow_clients_keep_nobody_waiting_and_are_let_go() {
    let (server, mut clients) = (start(), vec![]);
    for part in [
        "GET /$/ HTTP/1.1|X-Slow: ",
        "POST /$/set HTTP/1.1|Host: @|Content-Length: 900||{",
        "POST /set HTTP/1.1|Host: @|Content-Length: 900||{",
        "",
    ] {
        clients.extend((0..200).map(|_| server.send(part)));
        let began = Instant::now();
        let page = server.ask("GET /$/ HTTP/1.1|Host: @||");
        assert!(page.starts_with("http/1.1 200") && page.len() > 2000);
        assert!(began.elapsed() < Duration::from_secs(1), "{part}");
    }
    for mut client in clients {
        let end = client.read_to_end(&mut vec![]);
        assert!(!end.is_err_and(|e| e.kind() == ErrorKind::WouldBlock));
    }
}

#[test]
fn a_view_is_of_a_whole_image_and_is_not_printed() {
    for word in ["--dry-run", "--sample=1,1,0", "--crop=1,1,2x2", "--faces"]
    {
        let mut command = Command::new(env!("CARGO_BIN_EXE_ptview"));
        command.args(["../doc/examples/room.obj", word]);
        let run = command.output().unwrap();
        let fault = String::from_utf8(run.stderr).unwrap();
        assert_eq!(run.status.code(), Some(1), "{word}: {fault}");
        assert!(fault.contains("ptview shows whole images"), "{fault}");
    }
}
