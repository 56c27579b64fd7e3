//! Damaged pictures and meshes are errors or are read: no panic, no long wait, no memory that the file has no room for.
//!
//! `DAMAGE_SECONDS=600 cargo test --release -p loden --test all damage:: -- --ignored` damages them for ten minutes.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use loden::picture::Picture;
use loden::render::object;

/// The longest that a small file may take.
const LONGEST: Duration = Duration::from_secs(10);

/// The most memory that the process may have used, in KiB.
const MOST_MEMORY: u64 = 2 << 20;

/// Random numbers by splitmix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ z >> 31
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }

    /// Flips, cuts, pads or duplicates parts of a file.
    fn damage(&mut self, bytes: &mut Vec<u8>) {
        for _ in 0..1 + self.below(3) {
            let at = self.below(bytes.len());
            match self.below(7) {
                0 => bytes.truncate(at),
                1 => bytes.extend((0..1 + self.below(64)).map(|k| k as u8)),
                2 => {
                    let end = (at + 1 + self.below(64)).min(bytes.len());
                    let copy = bytes[at.min(end)..end].to_vec();
                    let place = self.below(bytes.len() + 1);
                    bytes.splice(place..place, copy);
                }
                3 => {
                    let end = (at + 1 + self.below(16)).min(bytes.len());
                    bytes.drain(at.min(end)..end);
                }
                4 => {
                    let value = [[0xff; 4], [0xff, 0xff, 0xff, 0x7f], [0; 4], [0, 0, 1, 0]][self.below(4)];
                    bytes.iter_mut().skip(at).zip(value).for_each(|(byte, value)| *byte = value);
                }
                _ => {
                    let bit = self.below(8);
                    bytes.iter_mut().skip(at).take(1).for_each(|byte| *byte ^= 1 << bit);
                }
            }
        }
    }
}

/// The test files of a kind.
fn files(kind: &str) -> Vec<(String, Vec<u8>)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(kind);
    let mut paths: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_none_or(|extension| extension != "txt"));
    paths.sort();
    let name = |path: &Path| path.file_name().unwrap().to_str().unwrap().to_owned();
    paths.iter().map(|path| (name(path), fs::read(path).unwrap())).collect()
}

/// Reads a picture by itself, and strictly, as one of an archive.
fn read_picture(path: &Path) -> loden::Result<()> {
    let alone = Picture::read(path, &mut Vec::new());
    loden::import::open(path.parent().unwrap(), &Default::default())?.image(0, 0)?;
    alone.map(|_| ())
}

fn read_mesh(path: &Path) -> loden::Result<()> {
    object::load(path.to_str().unwrap()).map(|_| ())
}

/// How a file of a kind is read.
type Read = fn(&Path) -> loden::Result<()>;

/// Reads damaged variants of all files until `is_over` says so; it is told the number of variants of each file.
fn damage_files(kind: &str, read: Read, is_over: impl Fn(u64) -> bool) {
    let files = files(kind);
    assert!(files.len() > 20, "only {} files of {kind}", files.len());
    let folder = tempfile::tempdir().unwrap();
    for seed in 0.. {
        if is_over(seed) {
            println!("{seed} variants of {} files", files.len());
            break;
        }
        for (k, (name, whole)) in files.iter().enumerate() {
            let mut bytes = whole.clone();
            let ending = name.rsplit('.').next().unwrap();
            let path = folder.path().join(format!("tl0 pl0 tv0 pv0.{ending}"));
            if seed == 0 {
                fs::write(&path, &bytes).unwrap();
                read(&path).unwrap_or_else(|error| panic!("{name} is whole: {error}"));
            }
            let mut random = Random(seed * 1000 + k as u64);
            random.damage(&mut bytes);
            fs::write(&path, &bytes).unwrap();
            let start = Instant::now();
            let outcome = std::panic::catch_unwind(|| read(&path));
            let seconds = start.elapsed();
            if outcome.is_err() || seconds > LONGEST {
                let kept = std::env::temp_dir().join(format!("damaged.{ending}"));
                fs::write(&kept, &bytes).unwrap();
                panic!(
                    "variant {seed} of {name}, kept as {}: {seconds:?}, panicked: {}",
                    kept.display(),
                    outcome.is_err()
                );
            }
            fs::remove_file(&path).unwrap();
            assert!(peak_memory() < MOST_MEMORY, "variant {seed} of {name} took {} KiB", peak_memory());
        }
    }
}

/// The most memory that the process has used, in KiB; 0 where the system does not tell.
fn peak_memory() -> u64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.trim().trim_end_matches(" kB").parse().ok()).unwrap_or(0)
}

#[test]
fn damaged_pictures_do_no_harm() {
    damage_files("pictures", read_picture, |seed| seed == 100);
}

#[test]
fn damaged_meshes_do_no_harm() {
    damage_files("meshes", read_mesh, |seed| seed == 300);
}

/// Half of the time for each kind.
#[test]
#[ignore = "takes DAMAGE_SECONDS, a minute by default"]
fn damage_for_a_long_time() {
    let seconds = std::env::var("DAMAGE_SECONDS").map_or(60, |seconds| seconds.parse().unwrap());
    for (kind, read) in [("pictures", read_picture as Read), ("meshes", read_mesh)] {
        let start = Instant::now();
        // other damage than in the short tests
        damage_files(kind, read, |_| start.elapsed() > Duration::from_secs(seconds) / 2);
    }
}
