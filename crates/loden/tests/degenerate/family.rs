//! Materials at the edges of what can be measured.

use loden::Error;
use loden::btf::{BtfMeta, BtfSource, Cosine, MemoryBtf, SampleType, Texels};
use loden::color::Encoding;
use loden::direction::DirectionSet;

/// A degenerate BTF and its name.
pub struct Member {
    pub name: &'static str,
    pub btf: MemoryBtf,
}

/// Size and directions of a member.
struct Shape {
    size: [usize; 2],
    views: usize,
    lights: usize,
    /// Whether the first two views and lights are the same direction.
    twice: bool,
}

const ORDINARY: Shape = Shape { size: [5, 4], views: 5, lights: 6, twice: false };

fn directions(count: usize, twice: bool) -> DirectionSet {
    let degrees = |i: usize| {
        let i = if twice { i.saturating_sub(1) } else { i } as f64;
        [(23.0 * i) % 78.0, (111.0 * i) % 360.0]
    };
    DirectionSet::from_degrees((0..count).map(degrees).collect()).unwrap()
}

fn meta(shape: &Shape, sample_type: SampleType) -> BtfMeta {
    let encoding = if sample_type == SampleType::U8 { Encoding::Srgb } else { Encoding::Linear };
    let [width, height] = shape.size;
    let [views, lights] = [shape.views, shape.lights].map(|count| directions(count, shape.twice));
    BtfMeta { width, height, views, lights, encoding, cosine: Cosine::Included, sample_type }
}

/// A rough material whose texels differ in colour and in how they reflect.
fn rough(meta: &BtfMeta) -> Vec<f32> {
    let mut values = Vec::new();
    for view in 0..meta.views.len() {
        for light in 0..meta.lights.len() {
            let (wi, wo) = meta.pair(view, light);
            let gloss = (wi + wo).normalize().z.powi(8);
            values.extend((0..meta.image_len()).map(|i| {
                let (texel, channel) = ((i / 3) as f32, (i % 3) as f32);
                let albedo = 0.3 + 0.2 * (1.7 * texel + channel).sin();
                wi.z * (albedo + (0.3 + 0.2 * (0.9 * texel).cos()) * gloss)
            }));
        }
    }
    values
}

fn stored(meta: BtfMeta, values: &[f32]) -> MemoryBtf {
    let texels = match meta.sample_type {
        SampleType::U8 => {
            let byte = |v: &f32| (meta.encoding.encode(*v) * 255.0).round().clamp(0.0, 255.0) as u8;
            Texels::U8(values.iter().map(byte).collect())
        }
        _ => Texels::F32(values.to_vec().into()),
    };
    MemoryBtf::new(meta, texels).unwrap()
}

/// A name, a size in texels, and pairs in degrees.
type List = (&'static str, [usize; 2], Vec<[f64; 4]>);

/// BTFs with their own list of pairs.
fn lists() -> Vec<Member> {
    let spread = |i: usize| {
        let i = i as f64;
        [(23.0 * i) % 78.0, (111.0 * i) % 360.0, (37.0 * i + 5.0) % 71.0, (67.0 * i) % 360.0]
    };
    let lowest =
        [[89.9, 10.0, 20.0, 30.0], [20.0, 30.0, 89.9, 10.0], [89.9, 0.0, 89.9, 180.0], [90.0, 0.0, 40.0, 90.0]];
    let lists: [List; 7] = [
        ("list of pairs", [5, 4], (0..11).map(spread).collect()),
        ("list of one pair", [5, 4], vec![spread(1)]),
        ("list of one pair of one texel", [1, 1], vec![spread(1)]),
        ("list of two pairs", [5, 4], vec![spread(1), spread(2)]),
        ("list of one pair seven times", [5, 4], vec![spread(1); 7]),
        ("list of pairs, some twice", [5, 4], (0..12).map(|i| spread(i / 2 + i % 3)).collect()),
        ("list of pairs, some at the horizon", [5, 4], (0..8).map(spread).chain(lowest).collect()),
    ];
    let member = |(name, [width, height], pairs): &List, sample_type| {
        let (views, lights) = (DirectionSet::normal(), DirectionSet::of_pairs(pairs).unwrap());
        let meta = BtfMeta { width: *width, height: *height, views, lights, ..meta(&ORDINARY, sample_type) };
        let values = rough(&meta);
        Member { name, btf: stored(meta, &values) }
    };
    lists.iter().flat_map(|list| [SampleType::F32, SampleType::U8].map(|numbers| member(list, numbers))).collect()
}

/// All members that hold numbers only.
pub fn finite() -> Vec<Member> {
    let shapes = [
        ("ordinary", ORDINARY),
        ("one texel", Shape { size: [1, 1], ..ORDINARY }),
        ("one row", Shape { size: [6, 1], ..ORDINARY }),
        ("one column", Shape { size: [1, 6], ..ORDINARY }),
        ("one view", Shape { views: 1, ..ORDINARY }),
        ("one light", Shape { lights: 1, ..ORDINARY }),
        ("one pair", Shape { views: 1, lights: 1, ..ORDINARY }),
        ("one texel of one pair", Shape { size: [1, 1], views: 1, lights: 1, ..ORDINARY }),
        ("equal directions", Shape { twice: true, ..ORDINARY }),
        ("nothing but equal directions", Shape { views: 2, lights: 2, twice: true, ..ORDINARY }),
    ];
    let mut members = Vec::new();
    for sample_type in [SampleType::F32, SampleType::U8] {
        for (name, shape) in &shapes {
            let meta = meta(shape, sample_type);
            let values = rough(&meta);
            members.push(Member { name, btf: stored(meta, &values) });
        }
        for (name, value) in [("constant", 0.25f32), ("black", 0.0), ("white", 1.0)] {
            let meta = meta(&ORDINARY, sample_type);
            let values = vec![value; meta.pairs() * meta.image_len()];
            members.push(Member { name, btf: stored(meta, &values) });
        }
    }
    members.extend(lists());
    let float = || meta(&ORDINARY, SampleType::F32);
    let ordinary = rough(&float());
    let mut add = |name, value: &dyn Fn(usize, f32) -> f32| {
        let values: Vec<f32> = ordinary.iter().enumerate().map(|(i, v)| value(i, *v)).collect();
        members.push(Member { name, btf: stored(float(), &values) });
    };
    add("values of 1e-30", &|_, v| 1e-30 * v);
    add("values of 1e6", &|_, v| 1e6 * v);
    add("negative in places", &|i, v| if i % 7 == 3 { -v } else { v });
    add("negative", &|_, v| -v);
    add("one bright value", &|i, v| if i == 100 { 5e4 } else { v });
    members
}

/// Ordinary members with one value that is no number.
pub fn not_finite() -> Vec<Member> {
    let member = |(name, value)| {
        let meta = meta(&ORDINARY, SampleType::F32);
        let mut values = rough(&meta);
        let middle = values.len() / 2;
        values[middle] = value;
        Member { name, btf: stored(meta, &values) }
    };
    [("NaN", f32::NAN), ("infinite", f32::INFINITY)].map(member).into()
}

/// All values of a source, as stored.
pub fn values(source: &dyn BtfSource) -> Vec<f32> {
    (0..source.meta().views.len()).flat_map(|view| source.view(view).unwrap().to_f32().into_owned()).collect()
}

pub fn largest(values: &[f32]) -> f32 {
    values.iter().fold(0.0, |most, v| most.max(v.abs()))
}

/// Root mean square difference.
pub fn rms(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    let squares: f64 = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    (squares / a.len() as f64).sqrt()
}

/// The mean over the texels of every image in place of the image.
pub fn mean_images(meta: &BtfMeta, values: &[f32]) -> Vec<f32> {
    let mut means = Vec::with_capacity(values.len());
    for image in values.chunks_exact(meta.image_len()) {
        let mean = |c: usize| image.iter().skip(c).step_by(3).sum::<f32>() / meta.texels() as f32;
        let rgb = [mean(0), mean(1), mean(2)];
        means.extend((0..meta.image_len()).map(|i| rgb[i % 3]));
    }
    means
}

/// Whether an error says which data or which parameter it is about.
pub fn names_its_cause(error: &Error) -> bool {
    matches!(
        error,
        Error::NonFinite { .. } | Error::Parameter { .. } | Error::Unsupported { .. } | Error::Invalid { .. }
    )
}
