use super::super::*;
use super::*;
use crate::progress::Silent;
use crate::random::{Stream, mix, unit};

/// Bumps of random sizes: irregular and smooth.
fn bumps(width: usize, height: usize) -> Exemplar {
    let mut random = Stream::new(5);
    let centres: Vec<[f32; 3]> = (0..70)
        .map(|_| [random.range(0.0, width as f32), random.range(0.0, height as f32), random.range(2.0, 6.0)])
        .collect();
    let value = |i: usize| {
        let (x, y) = ((i % width) as f32, (i / width) as f32);
        centres
            .iter()
            .map(|[cx, cy, r]| (1.0 - ((x - cx).powi(2) + (y - cy).powi(2)) / (r * r)).max(0.0))
            .fold(0.0, f32::max)
    };
    Exemplar::new(width, height, 1, (0..width * height).map(value).collect())
}

/// Squares of a chessboard with sides of 5.4 texels, with noise.
fn chessboard(side: usize) -> Exemplar {
    let square = |v: usize| (v as f64 / 5.4) as usize;
    let value = |i: usize| ((square(i % side) + square(i / side)) % 2) as f32 + 0.2 * unit(mix(i as u64));
    Exemplar::new(side, side, 1, (0..side * side).map(value).collect())
}

fn identity(exemplar: &Exemplar) -> SourceMap {
    SourceMap::from_fn(exemplar.width, exemplar.height, Source::new)
}

fn shuffled(exemplar: &Exemplar, side: usize) -> SourceMap {
    let (w, h) = (exemplar.width, exemplar.height);
    SourceMap::from_fn(side, side, |x, y| {
        let place = mix((y * side + x) as u64) as usize;
        Source::new(place % w, place / w % h)
    })
}

/// Blocks of 16 texels from random places.
fn random_blocks(exemplar: &Exemplar, side: usize) -> SourceMap {
    SourceMap::from_fn(side, side, |x, y| {
        let place = mix((y / 16 * side + x / 16) as u64) as usize;
        let (left, top) = (place % (exemplar.width - 16), place / 1000 % (exemplar.height - 16));
        Source::new(left + x % 16, top + y % 16)
    })
}

fn made(name: &str, exemplar: &Exemplar, side: usize) -> SourceMap {
    let method = by_name(name).unwrap();
    synthesize(method, exemplar, &Goal::new(side, side), &Values::defaults(method.params()), &Silent).unwrap()
}

#[test]
fn the_exemplar_itself_has_no_error() {
    let exemplar = bumps(64, 48);
    let found = Measures::new(&exemplar, &identity(&exemplar));
    assert_eq!((found.seam_energy, found.spectrum_error, found.patch_distance), (0.0, 0.0, [0.0; SCALES]));
    assert_eq!((found.patch_error, found.repetition), ([0.0; SCALES], 0.0));
    assert!((found.copy_length - f64::sqrt(64.0 * 48.0)).abs() < 1e-9 && (found.evenness - 1.0).abs() < 1e-9);
}

#[test]
fn seams_and_regions_are_those_of_the_map() {
    // two halves, the right one displaced by one row
    let value = |i: usize| (i / 8) as f32;
    let exemplar = Exemplar::new(8, 8, 1, (0..64).map(value).collect());
    let map = SourceMap::from_fn(8, 4, |x, y| Source::new(x, y + usize::from(x >= 4)));
    let found = Measures::new(&exemplar, &map);
    // neighbours of the exemplar differ by 1 down and by 0 across, 0.5 in the mean; those at the seam by 1
    assert_eq!(found.seam_energy, 2.0);
    assert_eq!(found.copy_length, 4.0);
    let corner = SourceMap::from_fn(16, 16, |_, _| Source::new(0, 0));
    let found = Measures::new(&bumps(64, 64), &corner);
    assert!(found.evenness < 0.01 && found.copy_length == 1.0);
}

#[test]
fn shuffled_texels_keep_values_but_neither_patches_nor_spectrum() {
    let exemplar = bumps(64, 64);
    let [found, blocks] =
        [shuffled(&exemplar, 128), random_blocks(&exemplar, 128)].map(|map| Measures::new(&exemplar, &map));
    assert!(found.patch_distance[0] > 3.0 * blocks.patch_distance[0], "{found:?} {blocks:?}");
    assert!(found.spectrum_error > 1.0 && found.spectrum_error > 2.0 * blocks.spectrum_error, "{found:?} {blocks:?}");
}

#[test]
fn repetition_is_the_share_of_texels_that_come_again_at_one_displacement() {
    let exemplar = bumps(64, 64);
    // the left half again at (48, 10), other texels from elsewhere
    let map = SourceMap::from_fn(96, 60, |x, y| match (x, y) {
        (0..48, 0..50) => Source::new(x, y),
        (48.., 10..) => Source::new(x - 48, y - 10),
        _ => Source::new((x * 7 + y) % 64, 63 - (y + 3 * x) % 9),
    });
    let found = Measures::new(&exemplar, &map).repetition;
    assert!((found - 1.0).abs() < 0.02, "{found}");
    assert!(Measures::new(&exemplar, &shuffled(&exemplar, 128)).repetition < 0.05);
    assert!(Measures::new(&exemplar, &random_blocks(&exemplar, 128)).repetition < 0.2);
}

#[test]
fn tiling_and_random_blocks_lose() {
    for exemplar in [bumps(64, 64), chessboard(64)] {
        let good = Measures::new(&exemplar, &made("optimise", &exemplar, 192));
        let tiling = Measures::new(&exemplar, &made("tiling", &exemplar, 192));
        let blocks = Measures::new(&exemplar, &random_blocks(&exemplar, 192));
        for worse in [tiling, blocks] {
            assert!(good.seam_energy < 0.5 * worse.seam_energy, "{good:?} {worse:?}");
            assert!(good.spectrum_error < worse.spectrum_error, "{good:?} {worse:?}");
        }
        assert!(good.patch_error[0] < blocks.patch_error[0], "{good:?} {blocks:?}");
        assert!(tiling.repetition > 0.99 && good.repetition < 0.5, "{good:?} {tiling:?}");
        assert!(good.copy_length < 0.8 * tiling.copy_length, "{good:?} {tiling:?}");
        assert!(good.patch_distance[0] < blocks.patch_distance[0], "{good:?} {blocks:?}");
        assert!(good.evenness > 0.9, "{good:?}");
    }
}

#[test]
fn a_held_out_half_tells_a_texture_from_blocks() {
    let exemplar = bumps(128, 64);
    let [left, right] = halves(&exemplar);
    assert_eq!(
        (left.width, right.width, left.texel(63, 5), right.texel(0, 5)),
        (64, 64, exemplar.texel(63, 5), exemplar.texel(64, 5))
    );
    let good = HeldOut::new(&exemplar, &made("optimise", &left, 128));
    let shuffled = HeldOut::new(&exemplar, &shuffled(&left, 128));
    assert_eq!(good.floor, shuffled.floor);
    assert!(good.floor[0] > 0.0 && good.result[0] < 2.5 * good.floor[0], "{good:?}");
    assert!(shuffled.result[0] > 2.0 * good.result[0], "{good:?} {shuffled:?}");
}
