//! Whole jobs: from the names a user gives to a result that can be shown, stored or sent.
//!
//! Every front end does the same things: open what the user names, describe, compare, compress, sweep, fit, factor,
//! evaluate, render, enlarge, edit and export it. These are the functions for it. They take file names and options and give structs; those
//! that a program may want to send elsewhere implement [`serde::Serialize`], with numbers as numbers. Progress, the
//! stages of a job and warnings go through [`crate::progress::Progress`].

mod acquire;
mod compare;
mod compress;
mod convert;
mod describe;
mod evaluate;
mod export;
mod factor;
mod family;
mod fit;
mod generate;
mod open;
mod plot;
mod rectify;
mod render;
mod samples;
mod shard;
mod sheet;
mod shown;
mod sweep;
mod synthesis_report;
mod synthesize;
mod synthesize_joined;
mod synthesize_surface;

pub use acquire::{BuiltSample, GRID, SampleKind, SampleRequest, built_in, coverage, measure, sample_kinds};
pub use compare::{BrdfComparison, Comparison, Comparisons, compare, compare_brdf, compare_files, compare_sources};
pub use compress::{CompressRequest, Compression, compress, compress_settings};
pub use convert::{BrdfConversion, BtfConversion, Conversion, ConvertRequest, convert};
pub use describe::{BrdfDescription, BtfDescription, CompressedDescription, Description, Pair, describe};
pub use evaluate::{Evaluation, Quantity, evaluate, evaluate_model};
pub use export::{Approximation, RendererExport, export_to};
pub use factor::{Factoring, factor};
pub use family::{Family, FamilyRequest, Variant, family};
pub use fit::{FitAt, FitRequest, Ranked, Ranking, rank};
pub use generate::{BlendRequest, Blended, EditRequest, Edited, ExchangeRequest, Exchanged, On, blend, edit, exchange};
pub use open::{Assignment, Opened, analytic, open, open_among, open_brdf, open_brdfs, open_btf};
pub use plot::{plot, spheres};
pub use rectify::{Photograph, Rectified, rectify};
pub use render::{Dressed, Light, Limits, Look, Paging, Render, Rendering, Subject, draw, render};
pub use samples::{read_samples, write_samples};
pub use shard::{ShardGoal, ShardNext, ShardPlan, next_shards, run_shard, shard_tasks};
pub use sheet::{Sheet, SheetRow, Worn, sheet};
pub use shown::{ERROR_GAIN, SHOWN, error_picture, photograph, shown_pairs, side_by_side, stored_picture};
pub use sweep::{
    Cost, Encode, Setting, SweepRow, Sweeping, Swept, Trouble, encode_here, middling, sweep, sweep_settings,
};
pub use synthesis_report::{SynthesisRow, SynthesisSample};
pub use synthesize::{Features, Sample, Store, SynthesisRequest, Synthesized, apply_map, read_mask, synthesize};
pub use synthesize_surface::{SurfaceMade, SurfaceRequest, synthesize_on};
