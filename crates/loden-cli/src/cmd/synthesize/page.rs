//! The page that compares methods of synthesis on one sample.

use loden::job::{SynthesisRow, SynthesisSample};

use super::super::page::Page;

/// JPEG quality of the pictures.
const QUALITY: u8 = 85;

/// Texels per side of the pictures of results.
const SIDE: usize = 512;

/// What the measures mean.
const MEANINGS: [(&str, &str); 9] = [
    (
        "seam energy",
        "Mean squared difference at boundaries between copied regions, relative to that between neighbours in the sample. \
         Smaller is better.",
    ),
    (
        "copy length",
        "Side of a square with the area of the region that a texel was copied with, in texels. Large regions hold structure, \
         but repeat what was seen.",
    ),
    (
        "repetition",
        "The largest share of texels that are copied again at one displacement: 1 for tiling. Smaller is better.",
    ),
    ("evenness", "How evenly the sample is used: 1 if all of it is used alike, 0 if one place is used alone."),
    (
        "patch error",
        "Difference between a patch of the result and the most similar one of the sample, which one patch in twenty exceeds, \
         at three scales, relative to the contrast of the sample. Patches across bad seams are like none. Smaller is better.",
    ),
    (
        "patches",
        "Sliced Wasserstein distance between the patches of the result and of the sample at three scales, relative to the \
         contrast of the sample. Smaller is better, but tiling has all patches of the sample.",
    ),
    ("spectrum", "Difference of the logarithms of the power spectra. Smaller is better; repetition shows here too."),
    (
        "flicker",
        "Seam energy of changes: the light moves half a circle around the sample in 20 frames, and what is compared is how texels \
         change from frame to frame. Up to 1, seams change as alike as neighbours in the sample. Only of a BTF.",
    ),
    (
        "held out",
        "Patch distance at the finest scale, and spectrum error, between the right half of the sample and a result made from \
         its left half alone; in brackets those between the two halves: below them, results are as good as the sample can \
         tell.",
    ),
];

/// Writes the page. `command` is the command line that asked for it.
pub fn page(name: &str, sample: &SynthesisSample, rows: &[SynthesisRow], command: &str) -> String {
    let (exemplar, size) = (&sample.exemplar, rows.first().map_or([0, 0], |row| [row.map.width, row.map.height]));
    let lead = format!(
        "A sample of {} x {} texels, made into {} x {} by every method.",
        exemplar.width, exemplar.height, size[0], size[1]
    );
    let mut page = Page::new(&format!("{name}: larger than the sample"), &lead).small(QUALITY);
    let beside = sample.pictures.len() + 1;
    page.heading("The sample");
    let pictures: Vec<_> = sample.pictures.iter().map(|(name, picture)| ((*name).to_owned(), picture)).collect();
    page.pictures_of(&pictures, beside, true);
    page.heading("Results");
    page.paragraph(&format!(
        "Every texel is a copy of one of the sample. The last picture of each row is the map: red is the column that a texel \
         was copied from, green the row. Results larger than {SIDE} texels show their top left corner."
    ));
    for row in rows {
        let results = sample.pictures_of(&row.map, SIDE);
        let map = sample.picture_of_map(&row.map, SIDE);
        let names = sample.pictures.iter().map(|(name, _)| format!("{}, {name}", row.method));
        let mut pictures: Vec<_> = names.zip(&results).collect();
        pictures.push((format!("{}, the map", row.method), &map));
        page.pictures_of(&pictures, beside, true);
    }
    page.heading("Measures");
    page.paragraph(
        "There is no ground truth: each measure says only where a result looks wrong. Those of a BTF are over images of eight \
         pairs of directions, some of them grazing.",
    );
    let header = [
        "method",
        "seconds",
        "seam energy",
        "copy length",
        "repetition",
        "evenness",
        "patch error, fine to coarse",
        "patches, fine to coarse",
        "spectrum",
        "flicker",
        "held out",
    ];
    page.table(&header, &rows.iter().map(cells).collect::<Vec<_>>());
    page.definitions(&MEANINGS);
    page.heading("The command");
    page.code(command);
    page.finish()
}

fn cells(row: &SynthesisRow) -> Vec<String> {
    let (measures, held) = (&row.measures, &row.held_out);
    let scales = |[fine, middle, coarse]: [f64; 3]| format!("{fine:.3}, {middle:.3}, {coarse:.3}");
    vec![
        row.method.to_owned(),
        format!("{:.2}", row.seconds),
        format!("{:.3}", measures.seam_energy),
        format!("{:.1}", measures.copy_length),
        format!("{:.3}", measures.repetition),
        format!("{:.3}", measures.evenness),
        scales(measures.patch_error),
        scales(measures.patch_distance),
        format!("{:.3}", measures.spectrum_error),
        row.flicker.map_or("–".into(), |flicker| format!("{flicker:.3}")),
        format!("{:.3} ({:.3}), {:.3} ({:.3})", held.result[0], held.floor[0], held.spectrum, held.spectrum_floor),
    ]
}
