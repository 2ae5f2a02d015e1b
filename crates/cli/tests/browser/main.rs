//! Pages and plots in Chromium without a window, over the DevTools protocol: on a phone, in print, and on a screen.

#[path = "../common/motor.rs"]
mod motor;
mod page;

use assert_cmd::Command;
use headless_chrome::{Browser, LaunchOptions};
use motor::PIVT6_TOML;
use page::{Cut, Page, Plot, Proof, Seen};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::TempDir;

/// Width of the narrowest common phones, and of an A4 page between margins of 15 mm, at 96 px an inch.
const PHONE: (u32, u32) = (390, 844);
const A4: (u32, u32) = (680, 1009);
const SCREEN: (u32, u32) = (1280, 900);
/// A page on a usual screen.
const WIDE: (u32, u32) = (1200, 900);
/// On a phone a table of numbers with more columns scrolls in its frame. Everything else is read without scrolling.
const PHONE_COLUMNS: usize = 6;
/// A page with text and plots: live on a screen and on a phone; as drawings on both and in print.
fn page_faults(browser: &Browser, file: &Path, least_plots: usize) -> Vec<String> {
    let mut faults = live_faults(browser, file, least_plots);
    let page = Page::still(browser, file);
    let wide = page.seen(WIDE, false, "screen");
    if wide.width > f64::from(WIDE.0) || wide.plots.len() < least_plots {
        faults.push(format!("at {} px {} plots, {} px wide", WIDE.0, wide.plots.len(), wide.width));
    }
    faults.extend(wide.cut.iter().map(|Cut { text, .. }| format!("at {} px cut off: {text}", WIDE.0)));
    faults.extend(wide.plots.iter().flat_map(Plot::faults).map(|fault| format!("at {} px {fault}", WIDE.0)));
    let phone = page.seen(PHONE, true, "screen");
    faults.extend(page.faults());
    let width = f64::from(PHONE.0);
    if phone.title.is_empty() || phone.texts < 200 || phone.plots.len() < least_plots {
        faults.push(format!("\"{}\": {} letters, {} plots", phone.title, phone.texts, phone.plots.len()));
    }
    if phone.width > width || phone.window > width {
        faults.push(format!("on a phone {} px wide", phone.width.max(phone.window)));
    }
    let scrolled = phone.cut.iter().filter(|cut| cut.columns <= PHONE_COLUMNS);
    faults.extend(scrolled.map(|Cut { text, .. }| format!("on a phone to be scrolled sideways: {text}")));
    faults.extend(phone.broken.iter().map(|name| format!("on a phone \"{name}\" is broken within a word")));
    faults.extend(phone.plots.iter().flat_map(Plot::faults).map(|fault| format!("on a phone {fault}")));

    let print = page.seen(A4, false, "print");
    let paper = f64::from(A4.0);
    if print.width > paper {
        faults.push(format!("in print {} px wide", print.width));
    }
    faults.extend(print.cut.iter().map(|Cut { text, .. }| format!("in print cut off at the right: {text}")));
    faults.extend(print.parted.iter().map(|caption| format!("in print \"{caption}\" may part from its plot")));
    faults.extend(printed_faults(&print));
    if !page.tab.print_to_pdf(None).is_ok_and(|pdf| pdf.starts_with(b"%PDF")) {
        faults.push("does not print".into());
    }
    faults
}

/// Plots and tables on paper: each plot once, and nothing cut.
fn printed_faults(print: &Seen) -> Vec<String> {
    let paper = f64::from(A4.0);
    let cut = |plot: &&Plot| {
        let [left, top, right, bottom] = plot.area;
        left < 0.0 || right > paper || bottom - top > f64::from(A4.1) || plot.breaks != "avoid"
    };
    let cut = print.plots.iter().filter(cut);
    let cut = cut.map(|plot| format!("in print a plot is cut: {:?}, break-inside {}", plot.area, plot.breaks));
    let split = print.split.iter().map(|table| format!("in print on two sheets: {table}"));
    let times = print.drawings.iter().filter(|count| **count != 1);
    let times = times.map(|count| format!("in print a plot is drawn {count} times"));
    let unread = print.plots.iter().flat_map(Plot::faults).map(|fault| format!("in print {fault}"));
    cut.chain(split).chain(times).chain(unread).collect()
}

/// The colour of what was measured, on every page.
const MEASURED: &str = "rgb(0,0,0)";

/// The page with its programs, at both widths.
fn live_faults(browser: &Browser, file: &Path, least_plots: usize) -> Vec<String> {
    let page = Page::open(browser, file);
    let mut faults = Vec::new();
    for (size, mobile) in [(WIDE, false), (PHONE, true)] {
        let seen = page.seen(size, mobile, "screen");
        let (live, dead, width) = (seen.live, seen.dead, seen.width.max(seen.window));
        if live < least_plots || dead > 0 {
            faults.push(format!("at {} px {live} plots are live, {dead} are not", size.0));
        }
        if width > f64::from(size.0) {
            faults.push(format!("at {} px {width} px wide with live plots", size.0));
        }
        faults.extend(seen.proofs.iter().flat_map(Proof::faults));
        let is_measured = |name: &str| name == "measured" || name.ends_with(", measured");
        let coloured = seen.colours.iter().filter(|(name, colour)| is_measured(name) && colour != MEASURED);
        faults.extend(coloured.map(|(name, colour)| format!("{name} is drawn in {colour}")));
        if seen.drawings.iter().any(|count| *count != 1) {
            faults.push(format!("at {} px plots are drawn {:?} times", size.0, seen.drawings));
        }
    }
    // A person prints what the screen shows.
    faults.extend(printed_faults(&page.seen(A4, false, "print")));
    faults.extend(page.faults());
    faults
}

/// A plot in a file of its own, on a screen.
fn plot_faults(browser: &Browser, file: &Path) -> Vec<String> {
    let page = Page::open(browser, file);
    let screen = page.seen(SCREEN, false, "screen");
    let mut faults = page.faults();
    if screen.plots.len() != 1 {
        faults.push("no plot".into());
    }
    faults.extend(screen.plots.iter().flat_map(Plot::faults));
    faults
}

fn browser() -> Option<Browser> {
    let Ok(path) = headless_chrome::browser::default_executable() else {
        assert!(std::env::var_os("CI").is_none(), "no browser for the pages: scripts/setup browser installs it");
        println!("skipped: no browser for the pages; install the package chromium (scripts/setup browser)");
        return None;
    };
    let arguments = ["--hide-scrollbars", "--allow-file-access-from-files"].map(OsStr::new);
    let options = LaunchOptions {
        path: Some(path),
        // Chromium's sandbox refuses root, which containers use. The browser only opens the program's own pages.
        sandbox: false,
        window_size: Some(SCREEN),
        args: arguments.to_vec(),
        // It waits for the pages, which take minutes on a busy computer.
        idle_browser_timeout: Duration::from_secs(3600),
        ..LaunchOptions::default()
    };
    Some(Browser::new(options).expect("the browser starts"))
}

/// The files that the program writes for a browser.
struct Files(TempDir);

impl Files {
    fn at(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn run(&self, arguments: &[&str]) {
        Command::cargo_bin("motorbench").unwrap().current_dir(self.0.path()).args(arguments).assert().success();
    }
}

const CIRCUIT: &str = "[supply]
voltage_V = 12
[encoder]
counts_per_rev = 2000
";
const SCENARIO: &str = "duration_s = 4.0\nmode = \"speed\"\n[settings]\nspeed_kp = 0.07\nspeed_ki = 1.5\n\
    [noise]\ncurrent_A = 0.01\n[[reference]]\ntime_s = 0.1\nvalue = 60\n[[reference]]\ntime_s = 1.1\nvalue = -40\n\
    [[reference]]\ntime_s = 2.3\nvalue = 15\n";

fn files() -> Files {
    let files = Files(TempDir::new().unwrap());
    let friction = format!("{PIVT6_TOML}[effects.coulomb_friction]\ntorque_Nm = 0.01\n");
    let (reference, other) = SCENARIO.split_once("[settings]").unwrap();
    std::fs::write(files.at("rig.toml"), format!("{CIRCUIT}{PIVT6_TOML}")).unwrap();
    std::fs::write(files.at("linear.toml"), PIVT6_TOML).unwrap();
    std::fs::write(files.at("friction.toml"), &friction).unwrap();
    std::fs::write(files.at("loop.toml"), format!("{reference}model = \"friction.toml\"\n[settings]{other}")).unwrap();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/pivt6");
    for name in ["table2_no_load.csv", "rig.toml"] {
        std::fs::copy(data.join(name), files.at(&format!("pivt6_{name}"))).unwrap();
    }
    files
}

fn none(faults: &[(String, Vec<String>)]) {
    let list: Vec<String> =
        faults.iter().flat_map(|(name, faults)| faults.iter().map(move |fault| format!("{name}: {fault}"))).collect();
    assert!(list.is_empty(), "{}", list.join("\n"));
}

#[test]
fn pages_are_read_on_a_phone_and_on_paper() {
    let Some(browser) = browser() else { return };
    let files = files();
    files.run(&["demo", "--seed", "3", "--report", "demo.html"]);
    files.run(&["simulate", "loop.toml", "--csv", "loop.csv"]);
    files.run(&["diagnose", "loop.csv", "--rig", "rig.toml", "--report", "diagnosis.html"]);
    let table = ["pivt6_table2_no_load.csv", "--rig", "pivt6_rig.toml", "--report", "table.html"];
    files.run(&[&["diagnose"], &table[..]].concat());
    for (quantity, page) in [("--speed", "speed.html"), ("--position", "position.html")] {
        files.run(&["design", "--rig", "rig.toml", quantity, "--bandwidth-Hz", "5", "--report", page]);
    }
    let validate = ["loop.csv", "--scenario", "loop.toml", "--model", "linear.toml", "--rig", "rig.toml"];
    files.run(&[&["validate"], &validate[..], &["--report", "validate.html"]].concat());
    files.run(&["compare", "linear.toml", "friction.toml", "--report", "compare.html"]);
    files.run(&["stand", "pivt6_table2_no_load.csv", "--rig", "pivt6_rig.toml", "--report", "stand.html"]);
    let pages = [
        ("demo.html", 9),
        ("diagnosis.html", 5),
        ("table.html", 2),
        ("speed.html", 8),
        ("position.html", 8),
        ("validate.html", 3),
        ("compare.html", 3),
        ("stand.html", 2),
    ];
    none(&pages.map(|(name, plots)| (name.to_string(), page_faults(&browser, &files.at(name), plots))));
}

#[test]
fn plots_are_read_on_a_screen() {
    let Some(browser) = browser() else { return };
    let files = files();
    files.run(&["simulate", "loop.toml", "--csv", "loop.csv", "--plot", "simulate.svg"]);
    let validate = ["loop.csv", "--scenario", "loop.toml", "--model", "linear.toml", "--rig", "rig.toml"];
    files.run(&[&["validate"], &validate[..], &["--plot", "validate.svg"]].concat());
    files.run(&["compare", "loop.csv", "linear.toml", "--rig", "rig.toml", "--plot", "compare.svg"]);
    files.run(&["compare", "linear.toml", "friction.toml", "--plot", "models.svg"]);
    files.run(&["stand", "pivt6_table2_no_load.csv", "--rig", "pivt6_rig.toml", "--map", "stand.svg"]);
    let plots = ["simulate.svg", "validate.svg", "compare.svg", "models.svg", "stand.svg"];
    none(&plots.map(|name| (name.to_string(), plot_faults(&browser, &files.at(name)))));
}

/// On the page of a diagnosis each named cause has one plot, or one picture of a wrong value, that can be seen with and
/// without JavaScript. What the plotted law explains is what the text says.
#[test]
fn each_named_cause_has_its_plot() {
    let Some(browser) = browser() else { return };
    let files = files();
    let recording = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/recording");
    for name in ["bench.toml", "rig.toml"] {
        std::fs::copy(recording.join(name), files.at(&format!("several_{name}"))).unwrap();
    }
    let nominal = format!("{CIRCUIT}{PIVT6_TOML}").replace("resistance_ohm = 5.84", "resistance_ohm = 12");
    std::fs::write(files.at("wrong_rig.toml"), nominal).unwrap();
    files.run(&["simulate", "several_bench.toml", "--csv", "several.csv"]);
    files.run(&["simulate", "loop.toml", "--csv", "wrong.csv"]);
    for (name, least) in [("several", 3), ("wrong", 2)] {
        let [table, rig, json, page] = [".csv", "_rig.toml", ".json", ".html"].map(|ending| format!("{name}{ending}"));
        files.run(&["diagnose", &table, "--rig", &rig, "--json", &json, "--report", &page]);
        let found: serde_json::Value = serde_json::from_slice(&std::fs::read(files.at(&json)).unwrap()).unwrap();
        let causes = found["causes"].as_array().unwrap().iter().map(|cause| cause["effect"].as_str().unwrap());
        let mut causes: Vec<&str> = causes.collect();
        causes.sort_unstable();
        assert!(causes.len() >= least, "{causes:?}");
        for page in [Page::open(&browser, &files.at(&page)), Page::still(&browser, &files.at(&page))] {
            let seen = page.seen(WIDE, false, "screen");
            let mut proven: Vec<&str> = seen.proofs.iter().map(|proof| proof.effect.as_str()).collect();
            proven.sort_unstable();
            assert_eq!(proven, causes);
            let faults: Vec<String> = seen.proofs.iter().flat_map(Proof::faults).collect();
            assert!(faults.is_empty(), "{faults:?}");
        }
    }
}

/// A plot that does not show its text is found.
#[test]
fn a_proof_that_proves_nothing_is_found() {
    let line = |name: &str, y: [f64; 3]| serde_json::json!({ "name": name, "x": [-1.0, 0.1, 1.0], "y": y });
    let mut dots = line("measured, all other causes taken out", [1.0, -1.0, -1.0]);
    dots["deviations"] = serde_json::json!([0.1, 0.1, 0.1]);
    let proof = |law: [f64; 3], percent: &str, drawn: usize| Proof {
        effect: "voltage_drop".into(),
        text: format!("The law explains {percent} % of what the model lacks without it."),
        numbers: Some(serde_json::json!({ "series": [line("fitted law", law), dots.clone()] }).to_string()),
        drawn,
    };
    assert!(proof([1.0, -1.0, -1.0], "100.0", 1).faults().is_empty());
    assert!(proof([1.0, -1.0, -1.0], "100.0", 0).faults()[0].contains("nothing is drawn"));
    assert!(proof([1.0, -1.0, 0.0], "100.0", 1).faults()[0].contains("the plotted law explains 66.7 %"));
}

/// The checks above can fail: here they find prepared problems.
#[test]
fn a_bad_page_is_found_bad() {
    let Some(browser) = browser() else { return };
    let files = files();
    let bad = "<html><head><title>bad</title></head><body><script>console.error('a complaint'); throw new Error('thrown')\
        </script><img src=\"http://127.0.0.1:9/picture.png\"><p>caption</p><svg width=\"900\" height=\"300\">\
        <polyline points=\"90,90 120,110\"/><rect x=\"80\" y=\"80\" width=\"99\" height=\"99\" fill=\"white\"/>\
        <text x=\"20\" y=\"40\" font-size=\"6\">small</text><text x=\"22\" y=\"40\" font-size=\"20\">over it</text>\
        <text x=\"880\" y=\"90\">beyond the edge</text></svg>\
        <figure class=\"plot\"><svg width=\"90\" height=\"30\"/><svg width=\"90\" height=\"30\"/></figure>\
        <p style=\"width:60px;overflow-wrap:anywhere\"><code>friction_asymmetry</code></p>\
        <pre style=\"width:60px;overflow-x:auto\">a line that no phone has the room for, since it goes on and on without an end</pre></body></html>";
    std::fs::write(files.at("bad.html"), bad).unwrap();
    let faults = page_faults(&browser, &files.at("bad.html"), 1).join("\n");
    let seen = [
        "a complaint",
        "thrown",
        "picture.png",
        "px wide",
        "px high",
        "in each other",
        "cut off",
        "is cut:",
        "are covered",
        "may part from its plot",
        "within a word",
        "is drawn 2 times",
        "on two sheets: a line",
        "scrolled sideways: a line",
    ];
    for expected in seen {
        assert!(faults.contains(expected), "{expected} was not seen:\n{faults}");
    }
}
