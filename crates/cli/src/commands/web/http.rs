//! As much of HTTP as a browser on this machine needs.

use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Longest head of a request.
const LONGEST_HEAD: usize = 16 * 1024;
/// A browser sends its request within this time.
const WAIT: Duration = Duration::from_secs(5);

/// A request, without a body.
pub(super) struct Request {
    /// The path, without the query.
    pub(super) path: String,
    query: String,
    /// The whole head, for a handshake.
    pub(super) head: Vec<u8>,
    headers: Vec<(String, String)>,
}

impl Request {
    /// Reads the head; `None`: it is none that is served here.
    pub(super) fn read(stream: &mut TcpStream) -> io::Result<Option<Self>> {
        stream.set_read_timeout(Some(WAIT))?;
        let (mut head, mut byte) = (Vec::new(), [0]);
        while !head.ends_with(b"\r\n\r\n") {
            if head.len() >= LONGEST_HEAD || stream.read(&mut byte)? == 0 {
                return Ok(None);
            }
            head.push(byte[0]);
        }
        Ok(Self::parse(head))
    }

    fn parse(head: Vec<u8>) -> Option<Self> {
        let text = std::str::from_utf8(&head).ok()?;
        let mut lines = text.split("\r\n");
        let mut words = lines.next()?.split(' ');
        let (method, target) = (words.next()?, words.next()?);
        if method != "GET" || !target.starts_with('/') {
            return None;
        }
        let (path, query) = target.split_once('?').unwrap_or((target, ""));
        let header = |line: &str| {
            let (name, value) = line.split_once(':')?;
            Some((name.to_ascii_lowercase(), value.trim().to_owned()))
        };
        let headers = lines.filter_map(header).collect();
        Some(Self { path: path.into(), query: query.into(), headers, head })
    }

    fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(of, _)| of == name).map(|(_, value)| value.as_str())
    }

    /// Whether it names this machine and this port as its host.
    pub(super) fn is_for(&self, port: u16) -> bool {
        let names = [format!("127.0.0.1:{port}"), format!("localhost:{port}")];
        self.header("host").is_some_and(|host| names.iter().any(|name| name == host))
    }

    /// Whether the page that asks was served here.
    pub(super) fn comes_from(&self, port: u16) -> bool {
        let names = [format!("http://127.0.0.1:{port}"), format!("http://localhost:{port}")];
        self.header("origin").is_some_and(|origin| names.iter().any(|name| name == origin))
    }

    /// The token in the query.
    pub(super) fn token(&self) -> Option<&str> {
        self.query.split('&').find_map(|pair| pair.strip_prefix("token="))
    }
}

/// Answers, and closes the connection.
pub(super) fn respond(stream: &mut TcpStream, status: u16, kind: &str, body: &[u8]) -> io::Result<()> {
    let words = match status {
        200 => "OK",
        400 => "Bad Request",
        403 => "Forbidden",
        _ => "Not Found",
    };
    let head = format!(
        "HTTP/1.1 {status} {words}\r\nContent-Type: {kind}\r\nContent-Length: {}\r\nCache-Control: no-cache\r\nX-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nConnection: close\r\n\r\n",
        body.len()
    );
    stream.write_all(head.as_bytes())?;
    stream.write_all(body)
}

/// The kind of a file of the page.
pub(super) fn kind(file: &str) -> &'static str {
    match file.rsplit('.').next() {
        Some("html") => "text/html; charset=utf-8",
        Some("js") => "text/javascript",
        Some("css") => "text/css",
        Some("wasm") => "application/wasm",
        Some("svg") => "image/svg+xml",
        Some("webmanifest") => "application/manifest+json",
        _ => "application/octet-stream",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(text: &str) -> Option<Request> {
        Request::parse(text.replace('\n', "\r\n").into_bytes())
    }

    #[test]
    fn only_pages_of_this_machine_are_answered() {
        let own =
            request("GET /port?a=1&token=12 HTTP/1.1\nHost: 127.0.0.1:80\nOrigin: http://127.0.0.1:80\n\n").unwrap();
        assert!(own.is_for(80) && own.comes_from(80) && !own.is_for(81) && !own.comes_from(81));
        assert_eq!((own.path.as_str(), own.token()), ("/port", Some("12")));
        let other = request("GET / HTTP/1.1\nHost: evil.example:80\nOrigin: http://evil.example\n\n").unwrap();
        assert!(!other.is_for(80) && !other.comes_from(80) && other.token().is_none());
        assert!(request("POST / HTTP/1.1\nHost: 127.0.0.1:80\n\n").is_none() && request("\n\n").is_none());
    }
}
