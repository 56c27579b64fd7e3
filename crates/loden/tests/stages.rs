//! Compression in tasks of other processes gives the bytes of a single process.

use std::borrow::Cow;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use loden::btf::{BtfMeta, BtfSource, Cosine, MemoryBtf, SampleType, Texels};
use loden::codec::{self, Finish, Goal, lossless};
use loden::color::Encoding;
use loden::direction::DirectionSet;
use loden::export;
use loden::job::{self, CompressRequest, ShardNext, ShardPlan};
use loden::memory::Memory;
use loden::params::Given;
use loden::progress::Silent;

/// A BTF of 3 x 4 pairs with patterns that differ in scale and direction, as `NAME.toml`.
fn source(folder: &Path, [width, height]: [usize; 2], sample_type: SampleType) -> PathBuf {
    let set = |n: usize, tilt: f64| {
        DirectionSet::from_degrees((0..n).map(|i| [tilt * i as f64, 70.0 * i as f64]).collect()).unwrap()
    };
    let (encoding, cosine) = (Encoding::Srgb, Cosine::Included);
    let meta = BtfMeta { width, height, views: set(3, 20.0), lights: set(4, 15.0), encoding, cosine, sample_type };
    let value = |i: usize| {
        let (image, texel, channel) = (i / meta.image_len(), i / 3 % meta.texels(), i % 3);
        let (x, y) = ((texel % width) as f32, (texel / width) as f32);
        let wave = (0.31 * x + 0.2 * image as f32).sin() * (0.17 * y + channel as f32).cos();
        let speckle = (i.wrapping_mul(0x9E37_79B9) >> 9) % 64;
        0.45 + 0.3 * wave + 0.1 * (0.05 * x * y).sin() + speckle as f32 / 640.0
    };
    let numbers = (0..meta.views.len() * meta.view_len()).map(value);
    let texels = match sample_type {
        SampleType::U8 => Texels::U8(Cow::Owned(numbers.map(|v| (v * 255.0) as u8).collect())),
        _ => Texels::F32(Cow::Owned(numbers.collect())),
    };
    let path = folder.join(format!("btf-{width}-{sample_type}.toml"));
    export::export(&MemoryBtf::new(meta, texels).unwrap(), &path, &Given::default(), &Silent).unwrap();
    path
}

/// A job as it would be given to a cluster.
struct Case<'a> {
    source: &'a Path,
    method: &'a str,
    params: &'a [(&'a str, &'a str)],
    goal: Goal,
    finish: Finish,
}

impl Case<'_> {
    fn given(&self) -> Given {
        self.params.iter().fold(Given::default(), |given, (name, text)| given.with(*name, *text))
    }

    fn open(&self) -> Arc<dyn BtfSource> {
        job::open_btf(self.source, &Given::default(), &Silent).unwrap()
    }

    /// The bytes of one process.
    fn single(&self, folder: &Path) -> Vec<u8> {
        let codec = codec::by_name(self.method).unwrap();
        let params = self.given().values(codec.params()).unwrap();
        let request = CompressRequest { codec, params, goal: self.goal, finish: self.finish, memory: None };
        let path = folder.join("single.loden");
        job::compress(self.open().as_ref(), &request, &path, &Silent).unwrap();
        fs::read(path).unwrap()
    }

    /// The bytes of many tasks, run in reverse, some of them twice, on two threads each.
    fn sharded(&self, folder: &Path, tasks: usize, memory: Option<Memory>) -> Vec<u8> {
        let (job, path) = (folder.join("job"), folder.join("sharded.loden"));
        let source = self.open();
        let plan =
            ShardPlan::new(source.as_ref(), &path, self.method, self.given(), self.goal, self.finish, tasks, memory);
        plan.unwrap().write(&job).unwrap();
        let pool = rayon_pool();
        loop {
            match job::next_shards(&job, &Silent).unwrap() {
                ShardNext::Done(_) => break,
                ShardNext::Tasks(waiting) => {
                    let plan = ShardPlan::read(&job).unwrap();
                    assert_eq!(job::shard_tasks(&job, waiting.stage).unwrap(), waiting.tasks);
                    for &task in waiting.missing.iter().rev() {
                        let (source, place) = (plan.open().unwrap(), [waiting.stage, task]);
                        let run = || job::run_shard(&job, &plan, source.as_ref(), place, &Silent);
                        pool(&run).unwrap();
                        if task % 3 == 0 {
                            // a worker whose result came too late
                            fs::remove_file(job.join(format!("stage-{:03}/task-{task:05}", waiting.stage))).unwrap();
                            pool(&run).unwrap();
                        }
                    }
                }
            }
        }
        assert!(!job.exists(), "the folder of the job is removed");
        fs::read(path).unwrap()
    }
}

type Run<'a> = &'a (dyn Fn() -> loden::Result<()> + Sync);

fn rayon_pool() -> impl Fn(Run) -> loden::Result<()> {
    |run| std::thread::scope(|scope| scope.spawn(run).join().unwrap())
}

fn same(case: &Case, tasks: &[usize]) {
    let dir = tempfile::tempdir().unwrap();
    let expected = case.single(dir.path());
    for &tasks in tasks {
        let found = case.sharded(dir.path(), tasks, None);
        assert!(found == expected, "{} {:?} in {tasks} tasks", case.method, case.params);
    }
}

const MEASURED: Finish = Finish { measure: true, lossless: None };

#[test]
fn tasks_give_the_bytes_of_a_single_process() {
    let dir = tempfile::tempdir().unwrap();
    let (bytes, floats) = (source(dir.path(), [45, 30], SampleType::U8), source(dir.path(), [45, 30], SampleType::F32));
    let cases: [(&str, &[(&str, &str)]); 11] = [
        ("pvmf", &[("components", "3")]),
        ("pca", &[("components", "5")]),
        ("svd", &[("components", "4"), ("domain", "log")]),
        ("klt", &[("components", "12")]),
        ("kmeans", &[("clusters", "20"), ("dimensions", "9")]),
        ("kmeans", &[("clusters", "20"), ("domain", "linear"), ("precision", "f16")]),
        ("pcmf", &[("clusters", "4"), ("components", "3"), ("dimensions", "8")]),
        ("tsvq", &[("clusters", "20")]),
        ("median-cut", &[("clusters", "20")]),
        ("median-cut", &[("clusters", "20"), ("split", "variance"), ("domain", "linear")]),
        ("median-cut", &[("clusters", "20"), ("space", "pca")]),
    ];
    for source in [&bytes, &floats] {
        for (method, params) in cases {
            same(&Case { source, method, params, goal: Goal::Params, finish: MEASURED }, &[1, 2, 7]);
        }
    }
}

/// Enough texels for a subsample, for several parts, and parts of several blocks.
#[test]
fn subsamples_are_divided_too() {
    let dir = tempfile::tempdir().unwrap();
    let source = source(dir.path(), [160, 110], SampleType::U8);
    for (method, components) in [("pca", "3"), ("pca", "20"), ("klt", "20")] {
        let params: &[(&str, &str)] = &[("components", components)];
        same(&Case { source: &source, method, params, goal: Goal::Params, finish: MEASURED }, &[3, 40]);
    }
}

#[test]
fn a_search_is_divided_too() {
    let dir = tempfile::tempdir().unwrap();
    let source = source(dir.path(), [24, 20], SampleType::U8);
    let finish = Finish { measure: true, lossless: Some(lossless::by_name("zstd").unwrap()) };
    for goal in [Goal::MaxError(0.04), Goal::Bytes(12_000)] {
        same(&Case { source: &source, method: "pvmf", params: &[], goal, finish }, &[2]);
    }
}

#[test]
fn a_memory_limit_divides_tasks_further() {
    let dir = tempfile::tempdir().unwrap();
    let source = source(dir.path(), [160, 110], SampleType::U8);
    let case = Case { source: &source, method: "pca", params: &[], goal: Goal::Params, finish: MEASURED };
    let expected = case.single(dir.path());
    assert!(case.sharded(dir.path(), 2, Some(Memory(46 << 20))) == expected);
    let opened = case.open();
    let small = Some(Memory(40 << 20));
    let plan =
        ShardPlan::new(opened.as_ref(), Path::new("x.loden"), "pca", case.given(), case.goal, case.finish, 2, small);
    let (plan, job) = (plan.unwrap(), dir.path().join("small"));
    plan.write(&job).unwrap();
    job::next_shards(&job, &Silent).unwrap();
    let error = job::run_shard(&job, &plan, opened.as_ref(), [0, 0], &Silent).unwrap_err().to_string();
    assert!(error.contains("memory: found 40.0 MiB, expected at least"), "{error}");
}

#[test]
fn what_cannot_be_divided_says_so() {
    let dir = tempfile::tempdir().unwrap();
    let path = source(dir.path(), [8, 6], SampleType::U8);
    let opened = job::open_btf(&path, &Given::default(), &Silent).unwrap();
    let plan = |source: &dyn BtfSource, method| {
        let output = Path::new("x.loden");
        ShardPlan::new(source, output, method, Given::default(), Goal::Params, MEASURED, 2, None).map(drop)
    };
    let error = plan(opened.as_ref(), "dfmf").unwrap_err().to_string();
    assert!(error.contains("dfmf cannot be distributed; these methods can: pvmf, pca, svd, klt, kmeans"), "{error}");
    let meta = BtfMeta { width: 2, height: 2, ..opened.meta().clone() };
    let texels = Texels::U8(Cow::Owned(vec![0; meta.views.len() * meta.view_len()]));
    let error = plan(&MemoryBtf::new(meta, texels).unwrap(), "pvmf").unwrap_err().to_string();
    assert!(error.contains("other processes must open it"), "{error}");
}
