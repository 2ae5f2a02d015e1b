//! `docs/reference/protocol.md` suffices to write a client: one in Python that uses nothing else talks to the firmware.

use crate::board::{Board, text, until};
use std::io::{Read, Write};
use std::process::Command;
use std::time::Duration;

const CLIENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../docs/reference/client.py");

/// Input of a user at a terminal, who then closes it. The drive continues.
fn type_in(board: &Board, lines: &[&str]) {
    let port = serialport::new(board.port().to_str().unwrap(), 500_000).timeout(Duration::from_millis(50));
    let mut line = port.open_native().unwrap();
    let (mut said, mut buffer) = (String::new(), [0; 256]);
    for (count, typed) in lines.iter().enumerate() {
        line.write_all(format!("{typed}\n").as_bytes()).unwrap();
        until(typed, || {
            let came = line.read(&mut buffer).unwrap_or(0);
            said += &String::from_utf8_lossy(&buffer[..came]);
            said.matches("ok\r\n").count() > count
        });
    }
}

/// The number after `name` in the line that begins with `line`.
fn number(said: &str, line: &str, name: &str) -> f64 {
    let found = said.lines().find(|said| said.starts_with(line)).unwrap_or_else(|| panic!("no {line} in\n{said}"));
    let rest = found.split_once(name).unwrap_or_else(|| panic!("no {name} in {found}")).1;
    rest.split_whitespace().next().and_then(|word| word.parse().ok()).unwrap_or_else(|| panic!("{name}: {found}"))
}

#[test]
fn a_client_written_from_the_page_reads_the_board() {
    if Command::new("python3").arg("--version").output().is_err() {
        eprintln!("python3 is missing: the client of the page is not tested");
        return;
    }
    let board = Board::new("protocol-page");
    // Scales that differ from the defaults, so the client must ask for them, and a motor that turns.
    type_in(&board, &["set speed_range 256 supply 10", "arm", "mode speed", "ref 50"]);
    board.order("wait 1");
    let done = Command::new("python3").arg("-B").arg(CLIENT).arg(board.port()).output().unwrap();
    let (said, errors) = (text(&done.stdout), text(&done.stderr));
    assert!(done.status.success(), "{said}{errors}");
    assert!(said.starts_with("motorbench ") && said.contains("\nreset: power on\n"), "{said}");
    // Information lines of `status`, assembled from text frames.
    assert!(said.contains("\n# mode speed armed 1 trip 0 none\n"), "{said}");
    assert!(number(&said, "samples ", "samples ") >= 50.0, "{said}");
    assert!(said.contains(" lost 0 damaged 0 every [10"), "{said}");
    assert!(said.contains("\nmode speed armed 1 enabled 1 trip 0\n"), "{said}");
    // The samples in SI units agree with the console's text from some moments before.
    let worded = "# reference ";
    for (name, of_console, bound) in [
        ("reference ", "# reference ", 0.01),
        ("speed ", "speed ", 1.0),
        ("current ", "current ", 0.05),
        ("supply ", "supply ", 0.01),
    ] {
        let (sampled, printed) = (number(&said, name, name), number(&said, worded, of_console));
        assert!((sampled - printed).abs() < bound && printed > 0.05, "{name}: {sampled} for {printed}\n{said}");
    }
    assert!((number(&said, "duty ", "duty ") - number(&said, worded, "duty ") / 100.0).abs() < 0.05, "{said}");
    // At most half a second at 50 rad/s is between the status and the last sample.
    let turned_rad = number(&said, "angle ", "angle ") - number(&said, worded, "position ");
    assert!((1.0..100.0).contains(&turned_rad), "{said}");
    // The client leaves the board in text mode with echo, ready for a user.
    let done = board.run("connect", &["status"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
}
