//! A terminal of tmux, for the programs that need one.

use crate::board::{Board, MOTORBENCH, text, until};
use std::process::Command;

/// A terminal of tmux with the tuning console in it, at 80 columns.
pub struct Terminal(pub String);

impl Terminal {
    /// Nothing, and why, where there is no tmux.
    pub fn new(board: &Board) -> Option<Self> {
        if Command::new("tmux").arg("-V").output().is_err() {
            println!("skipped: the tuning console is tested in tmux, which is not installed");
            return None;
        }
        let terminal = Self(board.folder.file_name().unwrap().to_string_lossy().into_owned());
        let console = format!(
            "cd {}; sh -c 'echo $$ > tune.pid; exec {MOTORBENCH} tune --port {} --reference 30'; echo exit $?; sleep 300",
            board.folder.display(),
            board.port().display()
        );
        terminal.tmux(&["new-session", "-d", "-x", "80", "-y", "30", "-s", &terminal.0, &console]);
        Some(terminal)
    }

    pub fn tmux(&self, arguments: &[&str]) -> String {
        // A server of its own, so that nobody's sessions are touched.
        text(&Command::new("tmux").args(["-L", &self.0]).args(arguments).output().unwrap().stdout)
    }

    pub fn press(&self, key: &str) {
        self.tmux(&["send-keys", "-t", &self.0, key]);
    }

    fn screen(&self) -> String {
        self.tmux(&["capture-pane", "-p", "-t", &self.0])
    }

    /// Waits until the screen shows a text.
    pub fn shows(&self, wanted: &str) {
        let mut screen = String::new();
        until(&format!("\"{wanted}\" on the screen"), || {
            screen = self.screen();
            screen.contains(wanted)
        });
    }

    /// Waits until the screen shows all of some texts.
    pub fn shows_at_once(&self, wanted: &[&str]) {
        until(&format!("{wanted:?} on the screen"), || {
            let screen = self.screen();
            wanted.iter().all(|text| screen.contains(text))
        });
    }

    /// Presses a key and waits for what it does.
    pub fn does(&self, key: &str, wanted: &str) {
        self.press(key);
        self.shows(wanted);
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        self.tmux(&["kill-server"]);
    }
}
