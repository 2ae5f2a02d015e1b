//! A low-pass of the first order behind the current of a period.

/// Two time constants whose quotient is nearer to one are the same.
const SAME: f64 = 1e-6;

/// A part of the period in which one voltage drives.
#[derive(Clone, Copy)]
pub(super) struct Piece {
    /// Of the period.
    pub length: f64,
    /// What it begins with.
    pub from: f64,
    /// By how much that would grow over a period without resistance.
    pub drive: f64,
}

impl Piece {
    /// A low-pass that follows this piece for ever, after a share of the period.
    fn followed(&self, since: f64, decay: f64, memory: f64) -> f64 {
        if decay == 0.0 {
            return self.from + self.drive * (since - memory);
        }
        // A low-pass as slow as the winding would need another form; one a little quicker does the same.
        let apart = 1.0 - decay * memory;
        let towards = self.drive / decay;
        towards + (self.from - towards) * (-decay * since).exp() / if apart.abs() < SAME { SAME } else { apart }
    }

    /// Its output after a share of the period, from this output at its begin.
    fn filtered(&self, begun: f64, since: f64, decay: f64, memory: f64) -> f64 {
        let apart = begun - self.followed(0.0, decay, memory);
        self.followed(since, decay, memory) + apart * (-since / memory).exp()
    }
}

/// The output of a low-pass at a share of a period that consists of these pieces, after many such periods.
pub(super) fn filtered(pieces: &[Piece], decay: f64, at: f64, memory: f64) -> f64 {
    let over =
        |begun: f64| pieces.iter().fold(begun, |begun, piece| piece.filtered(begun, piece.length, decay, memory));
    // What it began with long ago is forgotten.
    let mut output = over(0.0) / -(-1.0 / memory).exp_m1();
    let mut since = at;
    for piece in pieces {
        if since < piece.length {
            return piece.filtered(output, since, decay, memory);
        }
        output = piece.filtered(output, piece.length, decay, memory);
        since -= piece.length;
    }
    output
}
