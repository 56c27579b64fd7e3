//! Collects the files of the built page. In a copy of the repository where the page has not been built, the program is compiled all
//! the same, and the page says how to build it; a released package contains the page.

use std::path::PathBuf;
use std::{env, fs, io};

const FILES: [&str; 7] = ["index.html", "app.js", "app.css", "three.js", "three.webgpu.js", "three.tsl.js", "icon.svg"];

const MISSING: &str = "<!doctype html><meta charset=\"utf-8\"><title>loden studio</title><script type=\"importmap\">{}</script>
<p data-token=\"{TOKEN}\">The page of the studio is not part of this build. Run <code>make page</code>, which needs npm, and build again.</p>
";

fn main() -> io::Result<()> {
    let (page, out) = (PathBuf::from("page/dist"), PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default()));
    println!("cargo::rerun-if-changed={}", page.display());
    let built = page.join("index.html").is_file();
    if !built {
        println!("cargo::warning=the page of the studio has not been built: run make page");
    }
    for name in FILES {
        let content = match built {
            true => fs::read(page.join(name))?,
            false if name == "index.html" => MISSING.into(),
            false => Vec::new(),
        };
        fs::write(out.join(name), content)?;
    }
    Ok(())
}
