//! A page as the browser shows it.

use headless_chrome::protocol::cdp::types::Event;
use headless_chrome::protocol::cdp::{Emulation, Log::LogEntryLevel, Network, Runtime};
use headless_chrome::{Browser, Tab};
use serde::Deserialize;
use std::path::Path;
use std::sync::{Arc, Mutex};

/// Smallest letters that can be read.
const SMALLEST_LETTERS_PX: f64 = 9.0;
/// Tolerance for letters outside of their plot, and for overlapping texts.
const TOLERANCE_PX: f64 = 1.5;

/// Finds the texts of all plots, elements that are too wide, and names that are broken within a word.
const LOOK: &str = r"document.querySelectorAll('details').forEach(part => part.open = true), JSON.stringify({
    title: document.title,
    width: document.documentElement.scrollWidth,
    window: innerWidth,
    texts: document.body ? document.body.innerText.length : 0,
    cut: [...document.querySelectorAll('.wide, pre')].filter(box => box.scrollWidth > box.clientWidth + 1)
        .map(box => ({ text: box.innerText.slice(0, 60), columns: box.querySelectorAll('tr:first-child > *').length })),
    broken: [...document.querySelectorAll('code')].flatMap(code => [...code.childNodes]).filter(part => {
        const range = document.createRange();
        range.selectNodeContents(part);
        return new Set([...range.getClientRects()].map(line => Math.round(line.top))).size > 1;
    }).map(part => part.textContent),
    parted: [...document.querySelectorAll('p:has(+svg)')].filter(caption => getComputedStyle(caption).breakAfter != 'avoid')
        .map(caption => caption.innerText)
        .concat([...document.querySelectorAll('figure')].filter(figure => getComputedStyle(figure).breakInside != 'avoid').map(figure => figure.innerText)),
    proofs: [...document.querySelectorAll('.proof')].map(proof => ({
        effect: proof.dataset.effect,
        text: proof.innerText,
        numbers: proof.querySelector('figure.plot script')?.textContent ?? null,
        drawn: [...proof.querySelectorAll('svg, .live, .bar')].filter(drawing => drawing.getBoundingClientRect().height > 10).length,
    })),
    colours: [...document.querySelectorAll('figure.plot script')]
        .flatMap(numbers => JSON.parse(numbers.textContent).series.map(line => [line.name, line.colour])),
    drawings: [...document.querySelectorAll('figure.plot')].map(figure =>
        [...figure.querySelectorAll(':scope > svg, :scope > .live')].filter(drawing => drawing.getBoundingClientRect().height > 0).length),
    split: [...document.querySelectorAll('table, pre')].filter(table => !table.closest('.live') && getComputedStyle(table).breakInside != 'avoid')
        .map(table => table.innerText.slice(0, 60)),
    live: document.querySelectorAll('figure.is-live').length,
    dead: [...document.querySelectorAll('figure.plot:has(script)')].filter(figure => figure.clientWidth && !figure.classList.contains('is-live')).length,
    plots: [...document.querySelectorAll('svg:not(.ratio)')].filter(svg => svg.getBoundingClientRect().width).map(svg => {
        const box = svg.getBoundingClientRect();
        const opaque = [...svg.querySelectorAll('rect')].filter(rect => getComputedStyle(rect).fillOpacity == 1
            && getComputedStyle(rect).fill != 'none');
        const isWithin = (point, {x, y, width, height}) =>
            point.x > x + 1 && point.x < x + width - 1 && point.y > y + 1 && point.y < y + height - 1;
        const covers = (rect, line) => line.compareDocumentPosition(rect) & Node.DOCUMENT_POSITION_FOLLOWING
            && [...line.points].some(point => isWithin(point, rect.getBBox()));
        return {
            box: [box.left, box.top, box.right, box.bottom],
            breaks: getComputedStyle(svg).breakInside,
            covered: [...svg.querySelectorAll('polyline')].filter(line => opaque.some(rect => covers(rect, line))).length,
            lines: svg.querySelectorAll('polyline, circle, rect, path').length,
            texts: [...svg.querySelectorAll('text')].map(text => {
                const matrix = text.getScreenCTM(), box = text.getBoundingClientRect();
                const size = parseFloat(getComputedStyle(text).fontSize) * Math.hypot(matrix.a, matrix.b);
                return { text: text.textContent.trim(), size, box: [box.left, box.top, box.right, box.bottom] };
            }),
        };
    }),
})";

#[derive(Deserialize)]
pub struct Seen {
    pub title: String,
    pub width: f64,
    pub window: f64,
    pub texts: usize,
    pub cut: Vec<Cut>,
    pub broken: Vec<String>,
    /// Captions that may be printed on another sheet than their plot.
    pub parted: Vec<String>,
    /// What proves each cause.
    pub proofs: Vec<Proof>,
    /// Names and colours of all lines.
    pub colours: Vec<(String, String)>,
    /// Drawings of each plot that are seen.
    pub drawings: Vec<usize>,
    /// Tables that may be printed on two sheets.
    pub split: Vec<String>,
    /// Plots that can be zoomed, and those that should be and cannot.
    pub live: usize,
    pub dead: usize,
    pub plots: Vec<Plot>,
}

/// The plot of a cause, and what is written below it.
#[derive(Deserialize)]
pub struct Proof {
    pub effect: String,
    pub text: String,
    /// What is plotted: the law, and the measured lack with its deviations.
    pub numbers: Option<String>,
    /// Drawings that can be seen.
    pub drawn: usize,
}

/// What a plot has beside its drawing.
#[derive(Deserialize)]
pub struct Numbers {
    pub series: Vec<Series>,
}

#[derive(Deserialize)]
pub struct Series {
    pub name: String,
    #[serde(default)]
    pub x: Vec<f64>,
    pub y: Vec<f64>,
    #[serde(default)]
    pub deviations: Vec<f64>,
}

impl Series {
    /// Its value between two of its points.
    fn at(&self, x: f64) -> f64 {
        let after = self.x.partition_point(|other| *other < x).clamp(1, self.x.len() - 1);
        let [[x0, y0], [x1, y1]] = [after - 1, after].map(|index| [self.x[index], self.y[index]]);
        y0 + (y1 - y0) * ((x - x0) / (x1 - x0)).clamp(0.0, 1.0)
    }
}

impl Proof {
    /// Problems of the plot of a cause: none is seen, or it does not show what is written below it.
    pub fn faults(&self) -> Vec<String> {
        let Self { effect, text, numbers, drawn } = self;
        let mut faults = Vec::new();
        if *drawn == 0 {
            faults.push(format!("{effect}: nothing is drawn"));
        }
        let Some(numbers) = numbers else { return faults };
        let Numbers { series } = serde_json::from_str(numbers).expect("what a plot has");
        let [law, dots] = &series[..] else { return vec![format!("{effect}: {} lines", series.len())] };
        if law.name != "fitted law" || !dots.name.starts_with("measured") || dots.deviations.len() != dots.x.len() {
            return vec![format!("{effect}: {} and {}", law.name, dots.name)];
        }
        let sum = |of: &dyn Fn(usize) -> f64| {
            (0..dots.x.len()).map(|dot| (of(dot) / dots.deviations[dot]).powi(2)).sum::<f64>()
        };
        let left = sum(&|dot| dots.y[dot] - law.at(dots.x[dot]));
        let plotted = 100.0 * (1.0 - left / sum(&|dot| dots.y[dot])).max(0.0);
        let said =
            text.split_once("The law explains ").and_then(|(_, after)| after.split_once(" %")?.0.parse::<f64>().ok());
        match said {
            Some(said) if f64::abs(said - plotted) < MOST_APART_PERCENT => {}
            said => {
                faults.push(format!("{effect}: the plotted law explains {plotted:.1} %, and the text says {said:?}"))
            }
        }
        faults
    }
}

/// The law is plotted in finer bins than those of the measured lack, so a sum over the plot differs by a little.
const MOST_APART_PERCENT: f64 = 1.0;

/// Elements wider than their frame: they scroll on a screen, and are cut off in print.
#[derive(Deserialize)]
pub struct Cut {
    pub text: String,
    /// Elements of a table.
    pub columns: usize,
}

#[derive(Deserialize)]
pub struct Plot {
    /// Left, top, right, bottom in px, as for texts.
    #[serde(rename = "box")]
    pub area: [f64; 4],
    pub breaks: String,
    /// Lines with something drawn over them.
    pub covered: usize,
    pub lines: usize,
    pub texts: Vec<Text>,
}

#[derive(Deserialize)]
pub struct Text {
    pub text: String,
    pub size: f64,
    #[serde(rename = "box")]
    pub area: [f64; 4],
}

/// Smaller extent of the common part of two areas; positive if they overlap.
fn common([left, top, right, bottom]: [f64; 4], other: [f64; 4]) -> f64 {
    (right.min(other[2]) - left.max(other[0])).min(bottom.min(other[3]) - top.max(other[1]))
}

impl Plot {
    /// Problems for a reader.
    pub fn faults(&self) -> Vec<String> {
        let mut faults = Vec::new();
        let [left, top, right, bottom] = self.area;
        if self.lines == 0 || self.texts.is_empty() {
            faults.push("an empty plot".into());
        }
        if self.covered > 0 {
            faults.push(format!("{} lines of a plot are covered", self.covered));
        }
        for (index, text) in self.texts.iter().enumerate() {
            let [l, t, r, b] = text.area;
            if text.size < SMALLEST_LETTERS_PX {
                faults.push(format!("\"{}\" is {:.1} px high", text.text, text.size));
            }
            let outside = (left - l).max(top - t).max(r - right).max(b - bottom);
            if outside > TOLERANCE_PX {
                faults.push(format!("\"{}\" is cut off by {outside:.1} px", text.text));
            }
            for other in &self.texts[index + 1..] {
                if common(text.area, other.area) > TOLERANCE_PX {
                    faults.push(format!("\"{}\" and \"{}\" stand in each other", text.text, other.text));
                }
            }
        }
        faults
    }
}

/// A page in the browser, and the browser's complaints.
pub struct Page {
    pub tab: Arc<Tab>,
    pub heard: Arc<Mutex<Vec<String>>>,
}

impl Page {
    /// Opens a file and collects console messages, exceptions and requests to other hosts.
    pub fn open(browser: &Browser, file: &Path) -> Self {
        Self::opened(browser, file, true)
    }

    /// The same without its programs.
    pub fn still(browser: &Browser, file: &Path) -> Self {
        Self::opened(browser, file, false)
    }

    fn opened(browser: &Browser, file: &Path, runs_scripts: bool) -> Self {
        let url = format!("file://{}", file.display());
        let (tab, heard) = (browser.new_tab().unwrap(), Arc::new(Mutex::new(Vec::new())));
        tab.call_method(Network::Enable {
            max_total_buffer_size: None,
            max_resource_buffer_size: None,
            max_post_data_size: None,
            report_direct_socket_traffic: None,
            enable_durable_messages: None,
        })
        .unwrap();
        tab.enable_log().unwrap().enable_runtime().unwrap();
        let (notes, own) = (Arc::clone(&heard), url.clone());
        let note = move |event: &Event| {
            let complaint = match event {
                Event::RuntimeExceptionThrown(thrown) => Some(format!("{:?}", thrown.params.exception_details)),
                Event::RuntimeConsoleAPICalled(called)
                    if matches!(called.params.Type, Runtime::ConsoleAPICalledEventTypeOption::Error) =>
                {
                    Some(format!("{:?}", called.params.args))
                }
                Event::LogEntryAdded(added) if matches!(added.params.entry.level, LogEntryLevel::Error) => {
                    Some(added.params.entry.text.clone())
                }
                Event::NetworkRequestWillBeSent(request) => {
                    let asked = &request.params.request.url;
                    (*asked != own && !asked.starts_with("data:")).then(|| format!("asks for {asked}"))
                }
                _ => None,
            };
            notes.lock().unwrap().extend(complaint);
        };
        tab.add_event_listener(Arc::new(note)).unwrap();
        tab.call_method(Emulation::SetScriptExecutionDisabled { value: !runs_scripts }).unwrap();
        tab.navigate_to(&url).unwrap().wait_until_navigated().unwrap();
        Self { tab, heard }
    }

    /// The page on a screen of a size in px, or on paper.
    pub fn seen(&self, (width, height): (u32, u32), mobile: bool, media: &str) -> Seen {
        self.tab
            .call_method(Emulation::SetDeviceMetricsOverride {
                width,
                height,
                device_scale_factor: 1.0,
                mobile,
                scale: None,
                screen_width: None,
                screen_height: None,
                position_x: None,
                position_y: None,
                dont_set_visible_size: None,
                screen_orientation: None,
                viewport: None,
                display_feature: None,
                device_posture: None,
            })
            .unwrap();
        self.tab.call_method(Emulation::SetEmulatedMedia { media: Some(media.into()), features: None }).unwrap();
        let value = self.tab.evaluate(LOOK, false).unwrap().value.expect("a text");
        serde_json::from_str(value.as_str().expect("a text")).expect("what LOOK says")
    }

    pub fn faults(&self) -> Vec<String> {
        self.heard.lock().unwrap().clone()
    }
}
