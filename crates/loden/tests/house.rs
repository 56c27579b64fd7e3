//! House rules that a test can check: registries list every file, references exist, nothing names a machine.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use loden::params::Params;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn sources(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(sources(&path, extension));
        } else if path.extension().is_some_and(|e| e == extension) {
            found.push(path);
        }
    }
    found
}

/// Words like `ward1992` or `mueller2003b` in the `# References` sections of doc comments.
fn cited(text: &str) -> BTreeSet<String> {
    let mut keys = BTreeSet::new();
    let mut inside = false;
    for line in text.lines().map(str::trim_start) {
        let Some(doc) = line.strip_prefix("///").or_else(|| line.strip_prefix("//!")) else {
            inside = false;
            continue;
        };
        if doc.trim_start().starts_with('#') {
            inside = doc.trim() == "# References";
        } else if inside {
            keys.extend(doc.split(|c: char| !c.is_ascii_alphanumeric()).filter(|word| is_key(word)).map(str::to_owned));
        }
    }
    keys
}

fn is_key(word: &str) -> bool {
    let name = word.trim_end_matches(|c: char| c.is_ascii_lowercase());
    let letters = name.trim_end_matches(|c: char| c.is_ascii_digit());
    name.len() - letters.len() == 4
        && letters.len() > 1
        && letters.chars().all(|c| c.is_ascii_lowercase())
        && word.len() - name.len() <= 1
}

fn bibliography() -> Vec<String> {
    let text = fs::read_to_string(root().join("REFERENCES.bib")).unwrap();
    let entries = text.lines().filter(|line| line.starts_with('@'));
    entries.map(|line| line.split_once('{').unwrap().1.trim_end_matches(',').to_owned()).collect()
}

#[test]
fn every_cited_work_is_in_the_bibliography_and_sorted() {
    let keys = bibliography();
    assert!(keys.is_sorted(), "REFERENCES.bib is not sorted by key");
    let mut all = BTreeSet::new();
    for file in sources(&root().join("crates"), "rs") {
        for key in cited(&fs::read_to_string(&file).unwrap()) {
            assert!(keys.contains(&key), "{}: {key} is not in REFERENCES.bib", file.display());
            all.insert(key);
        }
    }
    assert!(all.len() > 3, "only {all:?} found: the search is broken");
    for key in keys {
        assert!(all.contains(&key), "{key} of REFERENCES.bib is cited nowhere");
    }
}

/// Files of a registry's folder, without the shared pieces.
fn entries(folder: &str, shared: &[&str]) -> BTreeSet<String> {
    let folder = root().join("crates/loden/src").join(folder);
    let names = fs::read_dir(&folder).unwrap().filter_map(|entry| {
        let path = entry.unwrap().path();
        // an entry is a file, or a folder if it needs several; a folder beside a file of the same name is part of it
        let part = path.is_dir() && path.with_extension("rs").exists();
        let name = path.file_stem()?.to_str()?.to_owned();
        (!part && name != "mod" && !shared.contains(&name.as_str())).then_some(name)
    });
    names.collect()
}

/// A module cannot have a dash in its name.
fn dashed(names: BTreeSet<String>) -> BTreeSet<String> {
    names.into_iter().map(|name| name.replace('_', "-")).collect()
}

fn names<'a>(all: impl Iterator<Item = &'a str>) -> BTreeSet<String> {
    all.map(str::to_owned).collect()
}

#[test]
fn every_file_of_a_registry_is_registered_under_its_name() {
    assert_eq!(
        dashed(entries("import", &["image_set", "named", "opened", "pattern", "rows", "tensor", "turned"])),
        names(loden::import::IMPORTERS.iter().map(|x| x.name()))
    );
    let (btf, brdf) = (loden::export::EXPORTERS, loden::export::BRDF_EXPORTERS);
    let exporters = btf.iter().map(|x| x.name()).chain(brdf.iter().map(|x| x.name()));
    assert_eq!(entries("export", &["bonn", "factored"]), names(exporters));
    assert_eq!(dashed(entries("codec/method", &[])), names(loden::codec::CODECS.iter().map(|x| x.name())));
    assert_eq!(
        entries("separable", &["joint", "matrix", "panel", "sparse", "stored", "tables"]),
        names(loden::separable::FACTORISATIONS.iter().map(|x| x.name()))
    );
    let shared =
        ["blocks", "endless", "features", "fft", "height", "map", "matching", "measure", "normal", "surface", "tests"];
    assert_eq!(dashed(entries("synth", &shared)), names(loden::synth::SYNTHESES.iter().map(|x| x.name())));
    let models = entries("model", &["analytic", "fresnel", "lobe", "microfacet", "tests"]);
    assert_eq!(dashed(models), names(loden::model::MODELS.iter().map(|x| x.name())));
    assert_eq!(entries("acquire/sample", &["maps", "noise"]), names(loden::acquire::SAMPLES.iter().map(|x| x.name())));
}

#[test]
fn every_example_is_short_and_a_section_of_the_guide() {
    let mut examples = sources(&root().join("crates/loden/examples"), "rs");
    examples.sort();
    let guide = fs::read_to_string(root().join("crates/loden/src/guide.rs")).unwrap();
    for (i, path) in examples.iter().enumerate() {
        let name = path.file_name().unwrap().to_str().unwrap();
        assert!(name.starts_with(&format!("{:02}_", i + 1)), "{name} is not number {}", i + 1);
        let include = format!("#![doc = include_str!(\"../examples/{name}\")]");
        assert_eq!(guide.matches(&include).count(), 1, "{name} is no section of guide.rs");
        let lines = fs::read_to_string(path).unwrap().lines().count();
        assert!((15..=40).contains(&lines), "{name} has {lines} lines, expected 15 to 40");
    }
    assert!(examples.len() >= 6, "only {} examples found: the search is broken", examples.len());
}

#[test]
fn every_importer_has_a_fuzz_target() {
    let targets = sources(&root().join("fuzz/src/bin"), "rs");
    let stems = targets.iter().map(|path| path.file_stem().unwrap().to_str().unwrap().replace('_', "-"));
    let targets: BTreeSet<String> = stems.collect();
    for importer in loden::import::IMPORTERS.iter().map(|x| x.name()) {
        // opened without an importer
        let target = if importer == "loden" { "container" } else { importer };
        assert!(targets.contains(target), "fuzz/src/bin has no target for {importer}");
    }
}

#[test]
fn every_default_is_a_value_and_every_name_a_flag() {
    let tables =
        loden::codec::CODECS.iter().map(|x| x.params()).chain(loden::acquire::SAMPLES.iter().map(|x| x.params()));
    let tables = tables
        .chain([loden::acquire::Options::TABLE, loden::acquire::photograph::Camera::TABLE])
        .chain([loden::acquire::mesh::Options::TABLE, loden::acquire::yarn::Options::TABLE])
        .chain(loden::model::MODELS.iter().map(|x| x.params()));
    let tables = tables
        .chain(loden::separable::FACTORISATIONS.iter().map(|x| x.params()))
        .chain(loden::synth::SYNTHESES.iter().map(|x| x.params()));
    for param in tables.flatten() {
        assert!(param.is_optional() || param.check(param.default).is_ok(), "{}: {:?}", param.name, param.default);
        assert!(param.name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-'), "{}", param.name);
        assert!(param.doc.ends_with('.'), "{}: {}", param.name, param.doc);
    }
}

/// The modules of the library by floor, from the ground up, as the table of ARCHITECTURE.md has them. A module may name
/// modules below it, and beside it as long as no circle arises.
fn floors() -> Vec<BTreeSet<String>> {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).unwrap();
    let table = text.split("\n## Floors\n").nth(1).unwrap().split("\n## ").next().unwrap();
    let rows = table.lines().filter(|line| line.starts_with("| ") && !line.starts_with("| floor"));
    let modules = |row: &str| row.split('|').nth(2).unwrap().split('`').skip(1).step_by(2).map(str::to_owned).collect();
    let mut floors: Vec<BTreeSet<String>> = rows.map(modules).collect();
    floors.reverse();
    assert_eq!(floors.len(), 8, "the table of ARCHITECTURE.md has other rows than expected");
    floors
}

/// The code of a file without its comments and its tests.
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    let text = text.split("#[cfg(test)]\nmod tests").next().unwrap();
    text.lines().map(|line| line.split("//").next().unwrap()).collect::<Vec<_>>().join("\n")
}

/// The modules that a text names after a prefix such as `crate::`: `crate::x` and `crate::{x, y::z}`.
fn named(text: &str, prefix: &str) -> BTreeSet<String> {
    let mut found = BTreeSet::new();
    for part in text.split(prefix).skip(1) {
        let mut depth = 0;
        let mut word = String::new();
        let mut first = true;
        for c in part.chars() {
            match c {
                'a'..='z' | '0'..='9' | '_' | 'A'..='Z' => word.push(c),
                '{' if word.is_empty() || depth > 0 => depth += 1,
                _ => {
                    if first && !word.is_empty() {
                        found.insert(word.clone());
                    }
                    word.clear();
                    first = c == ',' && depth == 1 || first && word.is_empty() && depth == 1 && c.is_whitespace();
                    depth -= usize::from(c == '}' && depth > 0);
                    if depth == 0 {
                        break;
                    }
                }
            }
        }
    }
    found
}

#[test]
fn modules_name_only_what_is_below_them() {
    let folder = root().join("crates/loden/src");
    let floors = floors();
    let floor = |module: &str| floors.iter().position(|floor| floor.contains(module));
    let mut names: Vec<(String, String)> = Vec::new();
    for file in sources(&folder, "rs") {
        let inside = file.strip_prefix(&folder).unwrap();
        let module = inside.iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs").to_owned();
        if module == "lib" || inside.iter().any(|part| part == "tests" || part == "tests.rs") {
            continue;
        }
        let own = floor(&module).unwrap_or_else(|| panic!("ARCHITECTURE.md has no floor for the module {module}"));
        for name in named(&code(&file), "crate::").into_iter().filter(|name| *name != module) {
            // items of the crate's root: Error, Result
            let Some(other) = floor(&name) else { continue };
            assert!(other <= own, "{}: {module} names {name}, which is above it", file.display());
            names.push((module.clone(), name));
        }
    }
    assert!(names.len() > 100, "only {} names found: the search is broken", names.len());
    assert_no_circle(&names);
}

/// Checks that pairs (module, module that it names) form no circle.
fn assert_no_circle(names: &[(String, String)]) {
    // remove modules that name no remaining module until none is left
    let mut left: BTreeSet<&str> = names.iter().flat_map(|(a, b)| [a.as_str(), b.as_str()]).collect();
    while !left.is_empty() {
        let leaf = |module: &&str| !names.iter().any(|(a, b)| a == module && left.contains(b.as_str()));
        let leaves: Vec<&str> = left.iter().copied().filter(leaf).collect();
        assert!(!leaves.is_empty(), "there is a circle among {left:?}");
        left.retain(|module| !leaves.contains(module));
    }
}

/// The files and folders of a module form no circle either.
#[test]
fn files_of_the_renderer_form_no_circle() {
    let folder = root().join("crates/loden/src/render");
    let exports = code(&folder.join("mod.rs"));
    let unit = |file: &Path| {
        file.strip_prefix(&folder).unwrap().iter().next().unwrap().to_str().unwrap().trim_end_matches(".rs").to_owned()
    };
    let units: BTreeSet<String> = sources(&folder, "rs").iter().map(|file| unit(file)).collect();
    // an item that mod.rs exports again stands for the file that it comes from
    let exported = |item: &str| {
        let word = |line: &&str| line.split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == item);
        let line = exports.split(';').find(|line| line.trim().starts_with("pub use ") && word(line))?;
        line.trim().strip_prefix("pub use ")?.split("::").next().map(str::to_owned)
    };
    let mut names: Vec<(String, String)> = Vec::new();
    for file in sources(&folder, "rs").into_iter().filter(|file| !file.ends_with("render/mod.rs")) {
        let (own, text) = (unit(&file), code(&file));
        if file.ends_with("tests.rs") {
            continue;
        }
        let mut found = named(&text, "crate::render::");
        // in x.rs and x/mod.rs, but not in x/y.rs, `super` is the module itself
        if file.parent() == Some(&folder) || file.ends_with("mod.rs") {
            found.append(&mut named(&text, "super::"));
        }
        let found =
            found.into_iter().filter_map(|name| if units.contains(&name) { Some(name) } else { exported(&name) });
        names.extend(found.filter(|other| *other != own).map(|other| (own.clone(), other)));
    }
    assert!(names.len() > 60, "only {} names found: the search is broken", names.len());
    assert_no_circle(&names);
}

#[test]
fn names_are_found_in_every_kind_of_import() {
    let text =
        "use crate::btf::{A, b}; use crate::{Error, Result, plot}; let x = crate::input::map(y); use crate::simd;";
    assert_eq!(
        named(text, "crate::").into_iter().collect::<Vec<_>>(),
        ["Error", "Result", "btf", "input", "plot", "simd"]
    );
    assert_eq!(
        named("use crate::{many::{self, B}, codec::C};", "crate::").into_iter().collect::<Vec<_>>(),
        ["codec", "many"]
    );
}

/// Cargo would not tell: the tests of a crate are one program, which names its files.
#[test]
fn no_file_of_tests_is_left_out() {
    for crate_ in ["loden", "loden-cli"] {
        let folder = root().join("crates").join(crate_).join("tests");
        let program = fs::read_to_string(folder.join("all.rs")).unwrap();
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let has_code = path.extension().is_some_and(|e| e == "rs") || path.join("mod.rs").is_file();
            let name = path.file_stem().unwrap().to_string_lossy().into_owned();
            let named = program.lines().any(|line| line == format!("mod {name};"));
            assert!(!has_code || name == "all" || named, "{} is not in tests/all.rs", path.display());
        }
    }
}
