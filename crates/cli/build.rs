//! Puts the page into the program: the files of the folder that MOTORBENCH_SITE names. `scripts/web` sets it.

use std::env;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).expect("the folder of the page can be read") {
        let path = entry.expect("the folder of the page can be read").path();
        if path.is_dir() { files(&path, found) } else { found.push(path) }
    }
}

fn main() {
    println!("cargo::rerun-if-env-changed=MOTORBENCH_SITE");
    let mut list = String::from("&[\n");
    if let Some(site) = env::var_os("MOTORBENCH_SITE").filter(|site| !site.is_empty()).map(PathBuf::from) {
        println!("cargo::rerun-if-changed={}", site.display());
        let mut found = Vec::new();
        files(&site, &mut found);
        found.sort();
        for path in found {
            let name = path.strip_prefix(&site).expect("it is in the folder").to_string_lossy().replace('\\', "/");
            let path = fs::canonicalize(&path).expect("the file is there");
            writeln!(list, "    ({name:?}, include_bytes!({:?})),", path.display().to_string()).expect("a text grows");
        }
    }
    list.push_str("]\n");
    let out = PathBuf::from(env::var_os("OUT_DIR").expect("cargo sets it")).join("site.rs");
    fs::write(out, list).expect("the output folder of cargo can be written");
}
