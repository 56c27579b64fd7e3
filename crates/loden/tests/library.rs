//! The material library: added materials are found, damage is detected, and manual edits are allowed.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::Synthetic;
use loden::direction::DirectionSet;
use loden::export;
use loden::import;
use loden::library::{AddOptions, Library};
use loden::params::Given;
use loden::progress::{Progress, Silent};

fn measurement(path: &Path) -> PathBuf {
    let mut source = Synthetic::bonn81(5, 4);
    source.meta.views = DirectionSet::from_degrees(vec![[0.0, 0.0], [30.0, 0.0]]).unwrap();
    source.meta.lights = DirectionSet::from_degrees(vec![[0.0, 0.0], [30.0, 0.0], [60.0, 90.0]]).unwrap();
    let raw = path.extension().is_some_and(|extension| extension == "toml");
    let options = if raw { Given::default() } else { Given::from([("png", "yes")]) };
    export::export(&source, path, &options, &Silent).unwrap();
    path.into()
}

fn add(library: &Library, name: &str, source: &Path, link: bool) -> loden::Result<()> {
    let options = AddOptions { link, methods: vec!["pvmf".into()], ..Default::default() };
    library.add(name, source, &options, &Silent).map(drop)
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { all.extend(files(&path)) } else { all.push(path) }
    }
    all.sort();
    all
}

#[test]
fn whatever_is_added_is_whole_and_opens() {
    let dir = tempfile::tempdir().unwrap();
    let at = dir.path();
    let library = Library::new(at.join("library"));
    fs::write(
        at.join("grey.astm"),
        "NUM_POINTS 1\nVARS theta_i,phi_i,theta_s,phi_s,R,G,B\n\n0.1,0,0.2,1,0.5,0.5,0.5\n",
    )
    .unwrap();
    fs::create_dir(at.join("lamps")).unwrap();
    image::RgbImage::new(2, 2).save(at.join("lamps/p1.png")).unwrap();
    fs::write(at.join("lamps/k.lp"), "1\np1.png 0 0.6 0.8\n").unwrap();
    fs::write(at.join("set.toml"), "loden_images = 1\nfiles = \"lamps/p{light}.png\"\ncount_from = 1\n").unwrap();
    let sources = ["a.zip", "folder", "raw.toml"].map(|name| measurement(&at.join(name)));
    let others = ["grey.astm", "lamps/k.lp", "set.toml"].map(|name| at.join(name));
    for (i, source) in sources.iter().chain(&others).enumerate() {
        let name = format!("m{i}");
        let options = AddOptions { methods: vec![], ..Default::default() };
        let record = library.add(&name, source, &options, &Silent).unwrap();
        let copied = at.join("library").join(&name).join(&record.original);
        let kind = import::open_named(&copied, &Default::default()).unwrap_or_else(|e| panic!("{e}")).0.name();
        assert_eq!(kind, record.kind);
        assert!(at.join("library").join(&name).join("thumbnail.png").is_file());
    }
    assert_eq!(library.names().unwrap(), ["m0", "m1", "m2", "m3", "m4", "m5"]);
    assert_eq!(library.verify(&[], &Silent).unwrap(), []);
}

#[test]
fn every_damaged_byte_of_every_file_is_found() {
    let dir = tempfile::tempdir().unwrap();
    let library = Library::new(dir.path().join("library"));
    add(&library, "wool", &measurement(&dir.path().join("a.zip")), false).unwrap();
    let place = dir.path().join("library/wool");
    let all = files(&place);
    assert_eq!(all.len(), 4, "{all:?}");
    let original = library.record("wool").unwrap();
    for file in &all {
        let whole = fs::read(file).unwrap();
        let described = file.ends_with("material.toml");
        for at in (0..whole.len()).step_by(whole.len().div_ceil(300)) {
            let mut damaged = whole.clone();
            damaged[at] ^= 0x01;
            fs::write(file, &damaged).unwrap();
            let found = library.verify(&[], &Silent).unwrap();
            // a text with the same meaning is not damaged
            let same = described && library.record("wool").is_ok_and(|record| record == original);
            assert!(same || found.iter().any(|f| f.damage), "byte {at} of {}", file.display());
        }
        fs::write(file, &whole[..whole.len() - 1]).unwrap();
        if !described {
            assert!(library.verify(&[], &Silent).unwrap()[0].problem.contains("bytes"));
        }
        fs::remove_file(file).unwrap();
        let lost = library.verify(&["wool".into()], &Silent).unwrap();
        assert!(lost.iter().any(|f| f.damage), "{} is missing", file.display());
        fs::write(file, &whole).unwrap();
        assert_eq!(library.verify(&[], &Silent).unwrap(), []);
    }
}

#[test]
fn edits_by_hand_are_welcome() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().join("library");
    let library = Library::new(&folder);
    add(&library, "wool", &measurement(&dir.path().join("a.zip")), false).unwrap();
    let description = folder.join("wool/material.toml");
    let text = fs::read_to_string(&description).unwrap();
    let edited = text.replace("notes = \"\"", "# mine\nnotes = \"from the market\"\ncolour = \"red\"");
    assert_ne!(edited, text);
    fs::write(&description, edited).unwrap();
    fs::rename(folder.join("wool"), folder.join("red wool")).unwrap();
    fs::write(folder.join("red wool/photo.txt"), "x").unwrap();
    fs::create_dir(folder.join("empty")).unwrap();
    assert_eq!(library.names().unwrap(), ["red wool"]);
    assert_eq!(library.record("red wool").unwrap().notes, "from the market");
    let findings = library.verify(&["red wool".into()], &Silent).unwrap();
    assert_eq!(findings.len(), 1);
    assert!(!findings[0].damage && findings[0].file == "photo.txt");
    fs::write(folder.join("red wool/material.toml"), "loden_material = ").unwrap();
    assert!(library.record("red wool").unwrap_err().to_string().contains("material.toml: line 1"));
}

/// Asks to stop after some steps, as a user would.
struct Impatient(std::sync::atomic::AtomicU64);

impl Progress for Impatient {
    fn is_cancelled(&self) -> bool {
        self.0.fetch_sub(1, std::sync::atomic::Ordering::Relaxed) == 0
    }
}

#[test]
fn an_interrupted_addition_leaves_nothing_and_a_killed_one_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let (folder, source) = (dir.path().join("library"), measurement(&dir.path().join("a.zip")));
    let library = Library::new(&folder);
    let options = AddOptions { methods: vec!["pvmf".into(), "pca".into()], ..Default::default() };
    for steps in 0..3 {
        let impatient = Impatient(std::sync::atomic::AtomicU64::new(steps));
        let result = library.add("wool", &source, &options, &impatient);
        assert!(matches!(result, Err(loden::Error::Cancelled)), "{steps}");
        assert_eq!(fs::read_dir(&folder).unwrap().count(), 0, "{steps}");
    }
    library.add("wool", &source, &options, &Silent).unwrap();
    assert_eq!(library.record("wool").unwrap().compressed.len(), 2);
    fs::create_dir(folder.join(".linen.x.partial")).unwrap();
    let findings = library.verify(&[], &Silent).unwrap();
    assert!(findings.len() == 1 && !findings[0].damage && findings[0].problem.contains("interruption"));
    assert_eq!(library.names().unwrap(), ["wool"]);
}

#[test]
fn linked_originals_stay_where_they_are_and_names_stay_inside() {
    let dir = tempfile::tempdir().unwrap();
    let (folder, source) = (dir.path().join("library"), measurement(&dir.path().join("a.zip")));
    let library = Library::new(&folder);
    add(&library, "wool", &source, true).unwrap();
    assert!(!folder.join("wool/original").exists());
    let opened = import::open(library.record("wool").unwrap().original, &Default::default()).unwrap();
    assert_eq!(opened.meta().pairs(), 6);
    assert!(add(&library, "wool", &source, true).unwrap_err().to_string().contains("already there"));
    for name in ["..", "../x", "a/b", "", ".hidden"] {
        assert!(matches!(add(&library, name, &source, true), Err(loden::Error::Parameter { .. })), "{name}");
    }
    let whole = fs::read(&source).unwrap();
    fs::write(&source, &whole[1..]).unwrap();
    assert!(library.verify(&[], &Silent).unwrap()[0].damage);
    library.remove("wool").unwrap();
    assert_eq!(library.names().unwrap(), Vec::<String>::new());
    assert!(source.is_file());
    assert!(library.remove("wool").is_err());
}

#[test]
fn forms_have_the_asked_parameters_and_can_be_added_later() {
    let dir = tempfile::tempdir().unwrap();
    let (folder, source) = (dir.path().join("library"), measurement(&dir.path().join("a.zip")));
    let library = Library::new(&folder);
    let options = |methods: &[&str], params: Given| AddOptions {
        methods: methods.iter().map(|m| (*m).into()).collect(),
        params,
        ..Default::default()
    };
    let fewer = Given::from([("components", "1")]);
    let first = library.add("wool", &source, &options(&["pvmf", "klt"], fewer.clone()), &Silent).unwrap();
    assert_eq!(first.compressed[0].file, Path::new("compressed/pvmf-components-1.loden"));
    assert!(first.compressed.iter().all(|form| form.values().unwrap().written("components").unwrap() == "1"));

    let later = library.compress("wool", &options(&["pvmf"], Given::from([("components", "2")])), &Silent).unwrap();
    assert_eq!(later.compressed[..2], first.compressed[..]);
    assert!(later.compressed[2].mean_abs_error < later.compressed[0].mean_abs_error);
    assert_eq!(library.record("wool").unwrap(), later);
    assert_eq!(library.verify(&[], &Silent).unwrap(), []);
    let opened = import::open(folder.join("wool").join(&later.compressed[2].file), &Default::default()).unwrap();
    assert_eq!(opened.meta().pairs(), 6);

    let error = |options: &AddOptions| library.compress("wool", options, &Silent).unwrap_err().to_string();
    assert!(error(&options(&["klt"], fewer)).contains("already has compressed/klt-components-1.loden"));
    assert!(error(&options(&["pvmf"], Given::from([("boxes", "2")]))).starts_with("boxes: none of the methods"));
    assert_eq!(library.record("wool").unwrap(), later);
}
