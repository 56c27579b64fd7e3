//! The page of a demo: its commands are those that ran.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::common::{LODEN, json, text, workshop};

/// Files of a folder by name, with their content; of pictures the pixels.
fn content(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let bytes = match path.extension().and_then(|e| e.to_str()) {
            // pictures hold the command that made them
            Some("png") => image::open(&path).unwrap().into_rgb8().into_raw(),
            Some("html") => continue,
            _ => fs::read(&path).unwrap(),
        };
        found.push((path, bytes));
    }
    found.sort();
    found
}

fn commands(page: &str) -> Vec<String> {
    let code = page.split("<pre>").nth(1).unwrap().split("</pre>").next().unwrap();
    let plain = code.replace("&quot;", "\"").replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&");
    plain.lines().map(str::to_owned).collect()
}

/// Runs the commands of a page in a shell; they must make the same files again.
fn check(at: &Path, folder: &str) {
    let before = content(&at.join(folder));
    let page = fs::read_to_string(at.join(folder).join("index.html")).unwrap();
    let commands = commands(&page);
    for (path, _) in &before {
        let name = path.file_name().unwrap().to_str().unwrap();
        assert!(commands.iter().any(|line| line.contains(name)), "no command makes {name}: {commands:?}");
    }
    for line in &commands {
        let script = line.replacen("loden", &format!("{LODEN} --force"), 1);
        let output = Command::new("bash").args(["-c", &script]).current_dir(at).output().unwrap();
        assert!(output.status.success(), "{line}: {}", text(&output.stderr));
    }
    let after = content(&at.join(folder));
    for ((path, before), (other, after)) in before.iter().zip(&after) {
        assert_eq!(path, other);
        assert!(before == after, "{} is another file when its command is run", path.display());
    }
    assert_eq!(before.len(), after.len());
}

#[test]
fn the_commands_of_a_demo_make_its_files() {
    let dir = workshop();
    let at = dir.path();
    // a name that a shell must be protected from
    fs::rename(at.join("small.zip"), at.join("small & 'mine'.zip")).unwrap();
    let done = Command::new(LODEN)
        .args(["demo", "small & 'mine'.zip", "--components", "2,4", "--draft", "-o", "the page", "--encoding", "srgb"])
        .current_dir(at)
        .output()
        .unwrap();
    assert!(done.status.success(), "{}", text(&done.stderr));
    check(at, "the page");
    let page = fs::read_to_string(at.join("the page/index.html")).unwrap();
    assert!(!page.contains("simulated") && page.contains("<svg") && page.contains("width=device-width"));
    for method in ["klt", "pvmf", "pca", "kmeans"] {
        let doc = loden::codec::by_name(method).unwrap().doc();
        assert!(page.contains(&format!("<dt>{method}</dt><dd>{doc}</dd>")), "{method}");
    }
}

#[test]
fn a_simulated_demo_says_so() {
    let dir = tempfile::tempdir().unwrap();
    json(dir.path(), "demo --size 4 --spp 1 --components 2 --draft");
    check(dir.path(), "loden-demo");
    let page = fs::read_to_string(dir.path().join("loden-demo/index.html")).unwrap();
    assert!(page.contains("6561 simulated images of 4 x 4 texels") && !page.contains("hotograph"));
}
