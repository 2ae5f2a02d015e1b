//! Makes the JavaScript side of `motorbench-web`: `motorbench-bindgen motorbench_web.wasm OUT`.

use std::env;
use std::error::Error;
use wasm_bindgen_cli_support::Bindgen;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = env::args().skip(1).collect();
    let [wasm, out] = &arguments[..] else { return Err("expected the .wasm file and a folder".into()) };
    let mut bindgen = Bindgen::new();
    bindgen.input_path(wasm).web(true)?.omit_default_module_path(false).typescript(true).remove_name_section(true).remove_producers_section(true);
    bindgen.generate(out)?;
    Ok(())
}
