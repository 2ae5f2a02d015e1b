//! Interruption of a running command by Ctrl-C, and its input lines from the terminal or a pipe.

use super::Failure;
use std::io::{BufRead, stdin};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, LazyLock};

/// Set by Ctrl-C and a closed terminal, after [`on_interrupt`].
pub(super) static STOPPED: LazyLock<Arc<AtomicBool>> = LazyLock::new(Arc::default);

/// Makes Ctrl-C and a closed terminal set this flag instead of ending the program. An opened link watches it as well.
pub(super) fn on_interrupt() -> Result<Arc<AtomicBool>, Failure> {
    ctrlc::set_handler(|| STOPPED.store(true, Ordering::Relaxed)).map_err(Failure::machine)?;
    Ok(Arc::clone(&STOPPED))
}

/// The lines from the terminal or a pipe. Reading blocks, so it runs in its own thread.
pub(super) fn typed_lines() -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let lines = stdin().lock().split(b'\n').map_while(Result::ok);
        lines
            .map(|line| String::from_utf8_lossy(line.trim_ascii_end()).into_owned())
            .try_for_each(|line| sender.send(line))
    });
    receiver
}
