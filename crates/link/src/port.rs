//! Serial ports: finds those that may be a board, and opens one exclusively.

use super::Link;
#[cfg(unix)]
use super::virtual_control::VirtualControl;
use crate::board::BoardError;
use motorbench_core::HARDWARE;
use serialport::{SerialPort, SerialPortType};
use std::fs::File;
use std::io;
#[cfg(unix)]
use std::os::fd::{AsRawFd as _, BorrowedFd};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// A read waits this long.
const WAIT: Duration = Duration::from_millis(5);
/// Length of the pulse that resets a board.
const RESET_PULSE: Duration = Duration::from_millis(250);
/// USB vendor and product of boards and of the chips that clones use.
const BOARDS: [(u16, u16, &str); 9] = [
    (0x2341, 0x0043, "Arduino Uno R3"),
    (0x2341, 0x0001, "Arduino Uno"),
    (0x2341, 0x0243, "Arduino Uno R3"),
    (0x2A03, 0x0043, "Arduino Uno R3"),
    (0x1A86, 0x7523, "CH340, as on many clones"),
    (0x1A86, 0x5523, "CH341, as on many clones"),
    (0x0403, 0x6001, "FT232, as on older boards"),
    (0x0403, 0x6015, "FT231X, as on clones"),
    (0x10C4, 0xEA60, "CP2102, as on clones"),
];

/// Default path of the port of `motorbench virtual`.
pub const USUAL_LINK: &str = "/tmp/motorbench";

/// A port on this computer.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Found {
    /// Its name, for `--port`.
    pub port: String,
    /// Its description.
    pub what: String,
    /// It is probably a board.
    pub board: bool,
    /// It is `motorbench virtual`.
    pub simulated: bool,
}

/// The ports of this computer, boards first, the virtual board behind the real ones.
///
/// # Errors
/// If the operating system does not list its ports.
pub fn ports() -> Result<Vec<Found>, String> {
    let ports = serialport::available_ports().map_err(|error| format!("the serial ports cannot be listed: {error}"))?;
    let found: Vec<Found> = ports.into_iter().map(|port| describe(port.port_name, &port.port_type)).collect();
    let mut found = once_each(found);
    found.extend(simulated(Path::new(USUAL_LINK)));
    found.sort_by_key(|port| (!port.board, port.simulated));
    Ok(found)
}

/// macOS has each port twice: `/dev/tty.NAME` waits for a carrier, which boards do not have; `/dev/cu.NAME` is the other.
fn once_each(found: Vec<Found>) -> Vec<Found> {
    let outgoing: Vec<String> =
        found.iter().filter_map(|port| Some(port.port.strip_prefix("/dev/cu.")?.into())).collect();
    let is_twin = |port: &Found| {
        port.port.strip_prefix("/dev/tty.").is_some_and(|name| outgoing.iter().any(|outgoing| outgoing == name))
    };
    found.into_iter().filter(|port| !is_twin(port)).collect()
}

/// The virtual board at a link, if one runs there.
#[cfg(unix)]
fn simulated(link: &Path) -> Option<Found> {
    VirtualControl::of(link)?;
    Some(Found {
        port: link.display().to_string(),
        what: "simulated (motorbench virtual)".into(),
        board: true,
        simulated: true,
    })
}

#[cfg(not(unix))]
fn simulated(_link: &Path) -> Option<Found> {
    None
}

fn describe(port: String, kind: &SerialPortType) -> Found {
    let SerialPortType::UsbPort(usb) = kind else {
        return Found { port, what: "not USB".into(), board: false, simulated: false };
    };
    let known = BOARDS.iter().find(|(vendor, product, _)| (*vendor, *product) == (usb.vid, usb.pid));
    let what = known.map_or_else(
        || usb.product.clone().unwrap_or_else(|| format!("USB {:04x}:{:04x}", usb.vid, usb.pid)),
        |(.., name)| (*name).to_string(),
    );
    Found { port, what, board: known.is_some(), simulated: false }
}

/// The port if none is named: the only board, or the virtual one if there is no other.
///
/// # Errors
/// When there is none, or more than one.
pub fn only_board() -> Result<String, String> {
    only_board_of(&ports()?)
}

fn only_board_of(found: &[Found]) -> Result<String, String> {
    let boards: Vec<&Found> = found.iter().filter(|port| port.board).collect();
    match &boards[..] {
        [board] => Ok(board.port.clone()),
        [board, simulated] if simulated.simulated => Ok(board.port.clone()),
        [] => Err("no board found: plug it in, or name its port with --port (`motorbench ports` lists all; without a board: `motorbench virtual &`)".into()),
        many => {
            let names: Vec<&str> = many.iter().map(|board| board.port.as_str()).collect();
            Err(format!("several boards: choose one with --port {}", names.join(" or ")))
        }
    }
}

/// A serial port, opened exclusively.
pub type Port = Box<dyn SerialPort>;

/// Opens a port and starts talking to the firmware there, unless `stopped` is set meanwhile.
///
/// # Errors
/// [`BoardError::Failed`] with what to do: missing, busy, not permitted; else as [`Link::start_unless`].
pub fn open(name: &str, stopped: Arc<AtomicBool>) -> Result<Link<Port>, BoardError> {
    Link::start_unless(open_line(name)?, stopped)
}

/// Opens a port at the speed of the firmware, for a program that speaks the protocol itself.
///
/// # Errors
/// [`BoardError::Failed`] with what to do: missing, busy, not permitted.
pub fn open_line(name: &str) -> Result<Port, BoardError> {
    // The operating system's message is clearer than that of the library.
    File::options().read(true).write(true).open(name).map_err(|error| BoardError::Failed(cannot_open(name, &error)))?;
    let port = serialport::new(name, HARDWARE.baud).timeout(WAIT).open_native().map_err(|error| {
        BoardError::Failed(match error.kind() {
            serialport::ErrorKind::NoDevice => busy(name),
            // The operating system says "Not a typewriter".
            _ if cfg!(unix) => format!("{name} is no serial port ({error}): `motorbench ports` lists the ports"),
            _ => format!("{name}: {error}; check that it is a serial port (`motorbench ports` lists them)"),
        })
    })?;
    #[cfg(unix)]
    let port = unblocked(port).map_err(|error| BoardError::Failed(format!("{name}: {error}")))?;
    Ok(Box::new(port))
}

/// Changes the speed of a line, for the bootloader of a board.
///
/// # Errors
/// The message of the operating system.
pub fn set_speed(port: &mut Port, baud: u32) -> io::Result<()> {
    Ok(port.set_baud_rate(baud)?)
}

/// Resets a board: its bootloader then listens for a new program.
///
/// # Errors
/// The message of the operating system. A virtual board has no such line.
pub fn reset(port: &mut Port) -> io::Result<()> {
    for high in [false, true] {
        port.write_data_terminal_ready(high)?;
        port.write_request_to_send(high)?;
        std::thread::sleep(RESET_PULSE);
    }
    Ok(())
}

/// Makes a read return at once: bytes that were seen may be gone to another program, and waiting for them would never
/// end.
#[cfg(unix)]
fn unblocked(port: serialport::TTYPort) -> io::Result<serialport::TTYPort> {
    // SAFETY: the port is open, and is so when this returns.
    let descriptor = unsafe { BorrowedFd::borrow_raw(port.as_raw_fd()) };
    rustix::io::ioctl_fionbio(descriptor, true)?;
    Ok(port)
}

fn busy(name: &str) -> String {
    format!("{name} is in use by another program: close its serial monitor, ravedude or motorbench")
}

fn cannot_open(name: &str, error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => format!("{name} does not exist: `motorbench ports` lists the ports"),
        io::ErrorKind::PermissionDenied => format!(
            "{name}: not permitted. Linux: `sudo usermod -aG dialout $USER`, then log in again. macOS: use the /dev/cu. name. Windows: close the program that holds the port"
        ),
        io::ErrorKind::ResourceBusy => busy(name),
        _ => format!("{name}: {error}; check that it is a serial port (`motorbench ports` lists them)"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn board(port: &str, simulated: bool) -> Found {
        Found { port: port.into(), what: String::new(), board: true, simulated }
    }

    #[test]
    fn a_real_board_goes_before_the_simulated_one() {
        let (one, two, simulated) = (board("/dev/ttyACM0", false), board("/dev/ttyACM1", false), board("/tmp/s", true));
        let other = Found { board: false, ..board("/dev/ttyS0", false) };
        assert_eq!(only_board_of(&[simulated.clone(), other.clone()]), Ok("/tmp/s".into()));
        assert_eq!(only_board_of(&[one.clone(), simulated.clone(), other.clone()]), Ok("/dev/ttyACM0".into()));
        let two = only_board_of(&[one, two, simulated]).unwrap_err();
        assert!(two.contains("--port /dev/ttyACM0 or /dev/ttyACM1 or /tmp/s"), "{two}");
        assert!(only_board_of(&[other]).unwrap_err().contains("no board found"));
    }

    #[test]
    fn a_port_with_two_names_is_one_board() {
        let names =
            ["/dev/cu.Bluetooth", "/dev/tty.Bluetooth", "/dev/tty.usbmodem1", "/dev/cu.usbmodem1", "/dev/tty.other"];
        let found = once_each(names.map(|name| Found { board: name.contains("usb"), ..board(name, false) }).into());
        let kept: Vec<&str> = found.iter().map(|port| port.port.as_str()).collect();
        assert_eq!(kept, ["/dev/cu.Bluetooth", "/dev/cu.usbmodem1", "/dev/tty.other"]);
        assert_eq!(only_board_of(&found), Ok("/dev/cu.usbmodem1".into()));
    }

    #[cfg(unix)]
    #[test]
    fn a_simulated_board_is_found_while_it_runs() {
        let folder = tempfile::tempdir().unwrap();
        let link = folder.path().join("board");
        assert_eq!(simulated(&link), None);
        let control = super::super::virtual_control::control_path(&link);
        let runs = std::os::unix::net::UnixListener::bind(&control).unwrap();
        assert_eq!(simulated(&link).map(|found| found.port), Some(link.display().to_string()));
        drop(runs);
        assert_eq!(simulated(&link), None, "the link of a killed board is not a port");
    }
}
