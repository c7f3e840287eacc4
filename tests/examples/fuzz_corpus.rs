//! Writes the valid inputs of each fuzz target: `cargo run -p supervol-tests --example fuzz_corpus -- FOLDER`.

fn main() -> std::io::Result<()> {
    let folder = std::env::args_os().nth(1).ok_or_else(|| std::io::Error::other("expected a folder"))?;
    for (name, _, valid) in supervol_tests::fuzz_bodies::all() {
        let target = std::path::Path::new(&folder).join(name);
        std::fs::create_dir_all(&target)?;
        for (number, bytes) in valid.iter().enumerate() {
            std::fs::write(target.join(format!("valid-{number}")), bytes)?;
        }
    }
    Ok(())
}
