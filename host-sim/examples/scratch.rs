use host_sim::dataset::Dataset;
use host_sim::recording::Recording;
use host_sim::rig::Rig;
fn main() {
    for dir in std::env::args().skip(1) {
        let rig = Rig::parse("rig.toml", &std::fs::read_to_string(format!("{dir}/rig.toml")).unwrap()).unwrap();
        let bytes = std::fs::read(format!("{dir}/recording.csv")).unwrap();
        let rec = Recording::parse("r.csv", &bytes[..], &[]).unwrap();
        println!("{dir}");
        match Dataset::new(&[rec], &rig) {
            Ok(d) => println!(
                "  written_after {} motion {:?} noise {:.4}",
                d.written_after,
                d.motion().output,
                d.motion().noise
            ),
            Err(e) => println!("{e}"),
        }
    }
}
