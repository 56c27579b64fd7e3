//! Compression within a memory limit.
//!
//! # Model
//! An encoder holds as many views as it has threads, plus tables whose size follows from the parameters. Each method
//! states its memory ([`Codec::memory`]), and as many threads run as fit the limit. The file is the same for any
//! number of threads.
//!
//! # Limits
//! What methods state is an upper bound, not a measurement. The limit must allow at least one thread with a whole
//! view.

use super::compress::{Goal, dialled};
use super::{CODECS, Codec, suited};
use crate::btf::BtfMeta;
use crate::memory::Memory;
use crate::params::Values;
use crate::{Error, Result};

/// The program itself, stacks and small buffers.
const PROGRAM: u64 = 40 << 20;

/// Bytes of single-precision numbers.
pub(super) fn singles(numbers: usize) -> u64 {
    4 * numbers as u64
}

/// Views being read, one decoded image per thread, and the buffers of the image comparison.
pub(super) fn source(meta: &BtfMeta, threads: usize) -> u64 {
    let view = (meta.view_len() * meta.sample_type.bytes()) as u64;
    (threads.min(meta.views.len()) as u64) * view + threads as u64 * singles(6 * meta.image_len())
}

/// Runs `work` on as many threads as `codec` may use within `memory`.
///
/// # Errors
/// [`Error::Parameter`] if even one thread exceeds the limit, or if the method does not state its memory; errors of
/// `work`.
pub fn within<T: Send>(
    memory: Memory,
    codec: &dyn Codec,
    meta: &BtfMeta,
    params: &Values,
    goal: Goal,
    work: impl FnOnce() -> Result<T> + Send,
) -> Result<T> {
    let threads = threads_within(memory, codec, meta, params, goal, rayon::current_num_threads())?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
    pool.map_err(|e| Error::parameter("threads", e.to_string()))?.install(work)
}

/// The largest number of threads, up to `most`, with which `codec` stays within the limit.
fn threads_within(
    Memory(memory): Memory,
    codec: &dyn Codec,
    meta: &BtfMeta,
    params: &Values,
    goal: Goal,
    most: usize,
) -> Result<usize> {
    let needed = |threads: usize| -> Result<u64> {
        let mut most = 0;
        for params in trials(codec, meta, params, goal)? {
            let (params, _) = suited(codec, meta, &params)?;
            most = most.max(PROGRAM + codec.memory(meta, &params, threads).ok_or_else(|| does_not_tell(codec, meta))?);
        }
        Ok(most)
    };
    let least = needed(1)?;
    if least > memory {
        let (found, least) = (Memory(memory), Memory(least.next_multiple_of(1 << 20)));
        let problem = format!("found {found}, expected at least {least} for {} of this source", codec.name());
        return Err(Error::parameter("memory", problem));
    }
    let mut threads = most.max(1);
    while threads > 1 && needed(threads)? > memory {
        threads -= 1;
    }
    Ok(threads)
}

/// The parameters at both ends of the search.
fn trials(codec: &dyn Codec, meta: &BtfMeta, params: &Values, goal: Goal) -> Result<Vec<Values>> {
    match goal {
        Goal::Params => Ok(vec![params.clone()]),
        _ => [0.0, 1.0].into_iter().map(|place| dialled(codec, meta, params, place)).collect(),
    }
}

fn does_not_tell(codec: &dyn Codec, meta: &BtfMeta) -> Error {
    let tell = |codec: &&&dyn Codec| codec.memory(meta, &Values::defaults(codec.params()), 1).is_some();
    let names: Vec<_> = CODECS.iter().filter(tell).map(|codec| codec.name()).collect();
    Error::parameter(
        "memory",
        format!("{} does not support a memory limit; these methods do: {}", codec.name(), names.join(", ")),
    )
}

#[cfg(test)]
mod tests {
    use super::super::by_name;
    use super::*;
    use crate::btf::{Cosine, SampleType};
    use crate::color::Encoding;
    use crate::direction::DirectionSet;

    fn meta(side: usize) -> BtfMeta {
        let set = DirectionSet::bonn81();
        let (encoding, cosine, sample_type) = (Encoding::Srgb, Cosine::Included, SampleType::U8);
        BtfMeta { width: side, height: side, views: set.clone(), lights: set, encoding, cosine, sample_type }
    }

    #[test]
    fn as_many_threads_as_fit() {
        let meta = meta(512);
        for method in ["pvmf", "pca", "svd", "klt", "neural", "kmeans", "median-cut", "tsvq", "pcmf"] {
            let codec = by_name(method).unwrap();
            let params = Values::defaults(codec.params());
            let needed = |threads: usize| PROGRAM + codec.memory(&meta, &params, threads).unwrap();
            for threads in 1..=8 {
                let found = |memory: u64| threads_within(Memory(memory), codec, &meta, &params, Goal::Params, 8);
                assert_eq!(found(needed(threads)).unwrap(), threads, "{method}");
                assert_eq!(found(needed(threads) - 1).ok(), (threads > 1).then(|| threads - 1), "{method}");
            }
            let error = threads_within(Memory(1 << 20), codec, &meta, &params, Goal::Params, 8).unwrap_err();
            assert!(error.to_string().contains("memory: found 1.0 MiB, expected at least"), "{error}");
        }
    }

    #[test]
    fn a_search_counts_with_its_largest_trial() {
        let (meta, klt) = (meta(512), by_name("klt").unwrap());
        let params = Values::defaults(klt.params());
        let of = |goal: Goal| threads_within(Memory(700 << 20), klt, &meta, &params, goal, 2);
        assert_eq!(of(Goal::Params).unwrap(), 2);
        assert!(of(Goal::MaxError(0.02)).is_err(), "256 components may be tried");
        let dfmf = by_name("dfmf").unwrap();
        let params = Values::defaults(dfmf.params());
        let error = threads_within(Memory(1 << 40), dfmf, &meta, &params, Goal::Params, 2);
        let error = error.unwrap_err().to_string();
        assert!(error.contains("dfmf does not support a memory limit; these methods do: pvmf, pca, svd"), "{error}");
    }
}
