//! Plots as files: SVG, or PNG for programs that do not read SVG.

use resvg::tiny_skia::{Pixmap, Transform};
use resvg::usvg::{Options, Tree};
use std::path::Path;

/// Pixels of a PNG for each unit of the drawing.
const SCALE: f32 = 2.0;

/// Format of a plot file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// Vector drawing.
    Svg,
    /// Pixels.
    Png,
}

/// The ending of the file's name is neither of the formats.
#[derive(Debug, thiserror::Error)]
#[error("expected a name that ends in .svg or .png")]
pub struct WrongEnding;

impl Format {
    /// By the ending of the file's name.
    ///
    /// # Errors
    /// [`WrongEnding`].
    pub fn of(path: &Path) -> Result<Self, WrongEnding> {
        let ending = path.extension().map(|ending| ending.to_string_lossy().to_ascii_lowercase());
        match ending.as_deref() {
            Some("svg") => Ok(Self::Svg),
            Some("png") => Ok(Self::Png),
            _ => Err(WrongEnding),
        }
    }
}

/// A drawing that cannot be rendered, with the reason of the renderer.
#[derive(Debug, thiserror::Error)]
#[error("the plot cannot be drawn as PNG ({0}): choose a name that ends in .svg")]
pub struct NotDrawn(String);

/// Renders the drawing as PNG. The program brings its font along.
///
/// # Errors
/// [`NotDrawn`].
pub fn png(svg: &str) -> Result<Vec<u8>, NotDrawn> {
    let failed = |reason: &dyn std::fmt::Display| NotDrawn(reason.to_string());
    let mut options = Options::default();
    let fonts = options.fontdb_mut();
    fonts.load_font_data(dejavu::sans::regular().to_vec());
    fonts.set_sans_serif_family("DejaVu Sans");
    let tree = Tree::from_str(svg, &options).map_err(|error| failed(&error))?;
    let size = tree.size().to_int_size().scale_by(SCALE).ok_or_else(|| failed(&"no size"))?;
    let mut pixels = Pixmap::new(size.width(), size.height()).ok_or_else(|| failed(&"too large"))?;
    resvg::render(&tree, Transform::from_scale(SCALE, SCALE), &mut pixels.as_mut());
    pixels.encode_png().map_err(|error| failed(&error))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panels::{Panel, panels};

    fn decoded(svg: &str) -> Pixmap {
        Pixmap::decode_png(&png(svg).unwrap()).unwrap()
    }

    /// Number of dark pixels in a part of the picture, in units of the drawing.
    fn dark(picture: &Pixmap, x: std::ops::Range<u32>, y: std::ops::Range<u32>) -> usize {
        let scaled = |range: &std::ops::Range<u32>| range.start * SCALE as u32..range.end * SCALE as u32;
        let pixel = |x, y| picture.pixel(x, y).expect("within the picture");
        scaled(&y).flat_map(|y| scaled(&x).map(move |x| pixel(x, y))).filter(|pixel| pixel.green() < 100).count()
    }

    #[test]
    fn a_png_shows_lines_and_text() {
        let panel = |title: &str| [Panel::new(title).line("a", vec![0.0, 1.0, 0.5])];
        let titled = decoded(&panels(1e-3, &panel("speed, rad/s")));
        let untitled = decoded(&panels(1e-3, &panel("")));
        assert_eq!((titled.width(), titled.height()), (1800, 480));
        let white = titled.pixel(2, 2).unwrap();
        assert_eq!((white.red(), white.green(), white.blue(), white.alpha()), (255, 255, 255, 255));
        // The title is upright along the left edge, the labels are right of it, the line is in the middle.
        assert!(dark(&titled, 0..28, 0..240) > 300, "{}", dark(&titled, 0..28, 0..240));
        assert_eq!(dark(&untitled, 0..28, 0..240), 0);
        assert!(dark(&titled, 40..74, 0..200) > 100 && dark(&titled, 100..880, 20..190) > 1000);
    }

    #[test]
    fn the_name_says_the_format() {
        assert_eq!(Format::of(Path::new("a/plot.svg")).unwrap(), Format::Svg);
        assert_eq!(Format::of(Path::new("plot.PNG")).unwrap(), Format::Png);
        for name in ["plot", "plot.jpg"] {
            assert!(Format::of(Path::new(name)).unwrap_err().to_string().contains(".png"));
        }
        assert!(png("no drawing").unwrap_err().to_string().contains(".svg"));
    }
}
