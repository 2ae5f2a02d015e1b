//! `docs/reference/protocol.md` is enough to write a client: one in Python that uses nothing else talks to the firmware.
#![cfg(all(unix, feature = "chip"))]

#[path = "common/board.rs"]
mod board;

use board::{Board, text};
use std::process::Command;

const CLIENT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/reference/client.py");

/// The number that stands behind `name` at the beginning of a line.
fn number(said: &str, name: &str) -> f64 {
    let line = said.lines().find_map(|line| line.strip_prefix(name)).unwrap_or_else(|| panic!("no {name} in\n{said}"));
    line.split_whitespace().next().and_then(|word| word.parse().ok()).unwrap_or_else(|| panic!("{name} {line}"))
}

#[test]
fn a_client_written_from_the_page_reads_the_board() {
    if Command::new("python3").arg("--version").output().is_err() {
        eprintln!("python3 is missing: the client of the page is not tried");
        return;
    }
    let board = Board::new("protocol-page");
    // Encoder, sensor and supply as a bench leaves them: the client has to scale each rightly.
    board.order("supply 9");
    board.order("turn 30");
    let done = Command::new("python3").arg(CLIENT).arg(board.port()).output().unwrap();
    let (said, errors) = (text(&done.stdout), text(&done.stderr));
    assert!(done.status.success(), "{said}{errors}");
    assert!(said.starts_with("motorbench ") && said.contains("\nreset: power on\n"), "{said}");
    // Information lines of `status`, put together from text frames.
    assert!(said.contains("\n# mode off armed 0 trip 0 none\n"), "{said}");
    assert!(said.contains("# illegal transitions 0, serial overruns 0, "), "{said}");
    assert!(number(&said, "samples ") >= 50.0, "{said}");
    assert!(said.contains(" lost 0 damaged 0 every [10"), "{said}");
    assert!(said.contains("\nmode off armed 0 enabled 0 trip 0\n"), "{said}");
    // The counts of the samples are the position that the console prints in rad; the hand is a few degrees off.
    let (degrees, printed_rad) = (number(&said, "angle "), number(&said, "# reference 0 position "));
    assert!((degrees - printed_rad.to_degrees()).abs() < 0.2 && (degrees - 30.0).abs() < 3.0, "{said}");
    assert!(number(&said, "speed ").abs() < 1.0 && number(&said, "current ").abs() < 0.1, "{said}");
    // Without a divider on A2 the board reports the setting.
    assert_eq!((number(&said, "duty "), number(&said, "supply ")), (0.0, 12.0), "{said}");
    // The client leaves the board to a person: text, with echo.
    let done = board.run("connect", &["status"]);
    assert!(done.status.success(), "{}", text(&done.stderr));
}
