//! Server of `lenscube view`: access control, parameter checks, pixel values; shell completions and manual pages.

mod access;
mod content;
mod manual;
mod raws;

use crate::common::test_job::TestJob;
use crate::common::{lenscube, pixels, text};
use pipeline::geometry::Size;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

struct Server {
    child: Child,
    port: u16,
}

impl Server {
    fn start(words: &[&str]) -> Self {
        let mut command = Command::new(env!("CARGO_BIN_EXE_lenscube"));
        command.arg("view").args(words);
        Self::start_as(command)
    }

    /// With at most `descriptors` open files.
    fn start_with_descriptors(words: &[&str], descriptors: usize) -> Self {
        let mut command = Command::new("sh");
        let limited = format!("ulimit -n {descriptors} && exec \"$0\" view \"$@\"");
        command.args(["-c", &limited, env!("CARGO_BIN_EXE_lenscube")]).args(words);
        Self::start_as(command)
    }

    fn start_as(mut command: Command) -> Self {
        command.stdout(Stdio::piped()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        let mut url = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut url).unwrap();
        let port = url.trim().strip_prefix("http://127.0.0.1:").and_then(|u| u.strip_suffix('/'));
        Self { child, port: port.unwrap_or_else(|| panic!("{url}")).parse().unwrap() }
    }

    /// Sends a raw request; status and complete response.
    fn send(&self, request: &str) -> (u16, Vec<u8>) {
        let mut stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        let status = String::from_utf8_lossy(&answer[..answer.len().min(12)]).into_owned();
        (status.get(9..12).and_then(|s| s.parse().ok()).unwrap_or_else(|| panic!("{status}")), answer)
    }

    fn get_as(&self, path: &str, headers: &str) -> (u16, Vec<u8>) {
        self.send(&format!("GET {path} HTTP/1.1\r\n{headers}Connection: close\r\n\r\n"))
    }

    fn get(&self, path: &str) -> (u16, Vec<u8>) {
        self.get_as(path, &format!("Host: 127.0.0.1:{}\r\n", self.port))
    }

    fn get_text(&self, path: &str) -> String {
        let (status, answer) = self.get(path);
        let answer = String::from_utf8_lossy(&answer).into_owned();
        assert_eq!(status, 200, "{path}: {answer}");
        answer
    }

    fn body(&self, path: &str) -> Vec<u8> {
        let (status, answer) = self.get(path);
        assert_eq!(status, 200, "{path}");
        let start = answer.windows(4).position(|w| w == b"\r\n\r\n").unwrap() + 4;
        answer[start..].to_vec()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn film() -> TestJob {
    let job = TestJob::large();
    job.run("", &["--no-fsync", "--pyramid"]).ok();
    job
}
