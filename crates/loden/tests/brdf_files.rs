//! BRDF files: values agree with independent ones, and samples with their density.

use std::f32::consts::{FRAC_PI_2, PI, TAU};
use std::fs;
use std::path::Path;
use std::sync::Arc;

use crate::common::chi_square::assert_sampling;
use crate::common::data;
use crate::common::tensor::{self, floats};
use glam::{Vec2, Vec3};
use loden::direction::{HalfDifference, from_angles, phi, theta};
use loden::import::{self, Measured};
use loden::material::Brdf;
use loden::params::Given;

fn open(path: impl AsRef<Path>) -> Arc<dyn Brdf> {
    open_with(path, &Default::default())
}

fn open_with(path: impl AsRef<Path>, options: &Given) -> Arc<dyn Brdf> {
    match import::open_named(path, options).unwrap().1 {
        Measured::Brdf(brdf) => brdf,
        _ => panic!("a BRDF is expected"),
    }
}

fn eval(brdf: &dyn Brdf, wi: Vec3, wo: Vec3) -> Vec3 {
    brdf.eval(Vec2::ZERO, wi, wo)
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn rgl_files_agree_with_the_laboratory_s_own_evaluation() {
    let folder = data("rgl_epfl");
    let text = fs::read_to_string(folder.join("reference_eval.csv")).unwrap();
    let (mut rows, mut worst) = (0, 0.0f32);
    let mut brdf: Option<(String, Arc<dyn Brdf>, f32)> = None;
    for line in text.lines().skip(1) {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |i: usize| cells[i].parse::<f32>().unwrap();
        if brdf.as_ref().is_none_or(|(name, ..)| name != cells[0]) {
            // the scale of a file is its largest reference value
            let own = text.lines().filter(|l| l.starts_with(cells[0]));
            let largest = |l: &str| l.split(',').skip(5).map(|w| w.parse::<f32>().unwrap()).fold(0.0, f32::max);
            brdf = Some((cells[0].into(), open(folder.join(cells[0])), own.map(largest).fold(0.0, f32::max)));
        }
        let (_, brdf, _) = brdf.as_ref().unwrap();
        let (wi, wo) = (from_angles(number(1), number(2)), from_angles(number(3), number(4)));
        let expected = Vec3::new(number(5), number(6), number(7));
        let found = eval(brdf.as_ref(), wi, wo) * wo.z;
        // relative to the row itself, with a floor where the value is close to zero
        let error = (found - expected).abs().max_element() / expected.abs().max_element().max(1e-3);
        assert!(error < 1e-3, "{line}\nfound {found}");
        worst = worst.max(error);
        rows += 1;
    }
    println!("{rows} rows, largest relative difference {worst:.2e}");
    assert_eq!(rows, 800);
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn white_paper_has_its_albedo() {
    let folder = data("rgl_epfl");
    let brdf = open(folder.join("paper_white_rgb.bsdf"));
    let (wi, n) = (from_angles(0.5, 0.0), 400);
    let mut sum = Vec3::ZERO;
    for i in 0..n * n {
        // uniform in projected solid angle
        let (r, p) = (((i / n) as f32 + 0.5) / n as f32, ((i % n) as f32 + 0.5) / n as f32 * TAU);
        let wo = from_angles(r.sqrt().asin(), p);
        sum += eval(brdf.as_ref(), wi, wo) * (PI / (n * n) as f32);
    }
    println!("albedo {sum}");
    assert!((sum.y - 0.84).abs() < 0.005, "{sum}");
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn cayman_peaks_at_the_mirror_direction() {
    let folder = data("cornell_pbrt_v2");
    let brdf = open(folder.join("cayman.brdf"));
    let wi = from_angles(60f32.to_radians(), 0.0);
    let value = |t: f32, p: f32| eval(brdf.as_ref(), wi, from_angles(t.to_radians(), p.to_radians())).y;
    let grid = (0..800).flat_map(|t| (0..181).map(move |p| (t as f32 * 0.1, p as f32 * 2.0)));
    let (t, p) = grid.max_by(|a, b| value(a.0, a.1).total_cmp(&value(b.0, b.1))).unwrap();
    println!("peak of the interpolated values at {t} {p}");
    // between the rows the mirror direction wins: it coincides with the lobes of other incident angles
    assert!((t - 60.0).abs() < 0.75 && (p - 180.0).abs() < 0.01, "{t} {p}");
    let samples = brdf.samples();
    assert_eq!(samples.len(), 1439);
    let at_60 = samples.iter().filter(|s| (s.wi - wi).length() < 1e-3);
    let peak = at_60.max_by(|a, b| a.value.y.total_cmp(&b.value.y)).unwrap();
    let found = (theta(peak.wo).to_degrees(), phi(peak.wo).to_degrees());
    assert!((found.0 - 59.3).abs() < 0.05 && (found.1 - 180.0).abs() < 0.05, "{found:?}");
    assert_eq!((brdf.wavelengths()[0], brdf.wavelengths().len()), (400.0, 31));
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn both_files_of_cayman_are_equal() {
    let (a, b) = (data("cornell_pbrt_v2"), data("cornell_astm"));
    let (a, b) = (open(a.join("cayman.brdf")), open(b.join("cayman.astm")));
    assert_eq!(a.samples(), b.samples());
    assert_eq!(a.wavelengths(), b.wavelengths());
    for i in 0..100 {
        let (wi, wo) = (from_angles(i as f32 * 0.015, 0.0), from_angles(1.4 - i as f32 * 0.01, i as f32));
        assert_eq!(eval(a.as_ref(), wi, wo), eval(b.as_ref(), wi, wo));
        assert_eq!(a.spectrum(wi, wo), b.spectrum(wi, wo));
    }
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn scattered_samples_are_met_exactly_and_reciprocally_where_they_are() {
    let folder = data("cornell_pbrt_v2");
    let mut reciprocal = 0;
    for name in ["cayman.brdf", "mystique.brdf", "acryl_blue.brdf"] {
        let brdf = open(folder.join(name));
        let samples = brdf.samples();
        let largest = samples.iter().map(|s| s.value.max_element()).fold(0.0, f32::max);
        // samples that contradict reciprocity are met as they are
        let is_reciprocal = brdf.promises().reciprocal;
        reciprocal += usize::from(is_reciprocal);
        let mut off = 0;
        for s in &samples {
            let forward = eval(brdf.as_ref(), s.wi, s.wo);
            let backward = eval(brdf.as_ref(), s.wo, s.wi);
            let difference = (forward - backward).abs().max_element();
            assert!(!is_reciprocal || difference <= 1e-3 * largest.max(1.0), "{name}: {forward} {backward}");
            off += usize::from((forward - s.value).abs().max_element() > 1e-3 * largest);
        }
        println!("{name}: {off} of {} rows share their place with another of a different value", samples.len());
        // rows with equal directions by symmetry and different values are averaged
        assert!(off * 20 < samples.len(), "{off}");
    }
    assert!(reciprocal > 0, "one of the files has reciprocal samples");
}

#[test]
#[ignore = "needs LODEN_DATA"]
fn curet_holds_61_materials() {
    let folder = data("curet");
    let path = folder.join("abrdf.dat");
    for index in [1, 13, 61] {
        let brdf = open_with(&path, &Given::default().with("index", index.to_string()));
        assert_eq!(brdf.samples().len(), 205);
    }
    assert!(open(&path).notes().warnings.iter().any(|w| w.contains("61 materials")));
    let beyond = Given::from([("index", "62")]);
    let error = import::open_named(&path, &beyond).err().unwrap().to_string();
    assert_eq!(error, "index: no material 62 among the 61");
    // the largest value, and that negative values exist
    let (mut largest, mut negative) = (0.0f32, 0);
    for index in 1..=61 {
        let brdf = open_with(&path, &Given::default().with("index", index.to_string()));
        largest = brdf.samples().iter().map(|s| s.value.y).fold(largest, f32::max);
        let fact = &brdf.notes().facts.iter().find(|(name, _)| *name == "negative").unwrap().1;
        negative += fact.parse::<usize>().unwrap() / 3;
    }
    let text = fs::read_to_string(&path).unwrap();
    let all = || text.lines().flat_map(|l| l.split_whitespace().skip(1)).map(|w| w.parse::<f32>().unwrap());
    assert_eq!(largest, all().fold(0.0, f32::max));
    assert_eq!(negative, all().filter(|v| *v < 0.0).count());
}

/// An isotropic, reciprocal, glossy BRDF in closed form.
fn closed_form(wi: Vec3, wo: Vec3) -> Vec3 {
    let HalfDifference { wh, wd } = HalfDifference::new(wi, wo);
    Vec3::new(0.2, 0.1, 0.05) + Vec3::splat(2.0 * wh.z.powi(60) * (1.5 - wd.z))
}

fn merl_bytes(value: impl Fn(Vec3, Vec3) -> Vec3) -> Vec<u8> {
    let scale = [1.0 / 1500.0, 1.15 / 1500.0, 1.66 / 1500.0f64];
    let mut bytes: Vec<u8> = [90i32, 90, 180].iter().flat_map(|d| d.to_le_bytes()).collect();
    let mut planes = vec![Vec::new(); 3];
    for i in 0..90 * 90 * 180 {
        let (h, d, p) = (i / 16200, i / 180 % 90, i % 180);
        let theta_h = ((h as f32 + 0.5) / 90.0).powi(2) * FRAC_PI_2;
        let wd = from_angles((d as f32 + 0.5).to_radians(), (p as f32 + 0.5).to_radians());
        let (wi, wo) = HalfDifference { wh: from_angles(theta_h, 0.0), wd }.directions();
        let rgb = if wi.z > 0.0 && wo.z > 0.0 { value(wi, wo) } else { Vec3::splat(-1.0) };
        for (channel, plane) in planes.iter_mut().enumerate() {
            let v = if rgb.x < 0.0 { -1.0 } else { f64::from(rgb[channel]) / scale[channel] };
            plane.extend_from_slice(&v.to_le_bytes());
        }
    }
    bytes.extend(planes.concat());
    bytes
}

#[test]
fn a_merl_file_gives_the_function_it_was_made_of() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.binary");
    let bytes = merl_bytes(closed_form);
    assert_eq!(bytes.len(), 34_992_012);
    fs::write(&path, &bytes).unwrap();
    let brdf = open(&path);
    for i in 0..500 {
        let (wi, wo) = (from_angles(0.003 * i as f32, i as f32), from_angles(1.45 - 0.0028 * i as f32, 2.4 * i as f32));
        let (found, expected) = (eval(brdf.as_ref(), wi, wo), closed_form(wi, wo));
        assert!((found - expected).abs().max_element() < 0.01 * expected.max_element(), "{i} {found} {expected}");
    }
    assert_sampling(brdf.as_ref(), "merl");
    fs::write(&path, &bytes[..bytes.len() - 8]).unwrap();
    let error = import::open_named(&path, &Default::default()).err().unwrap().to_string();
    assert!(
        error.contains("x.binary: size: found 34992004 bytes, expected 34992012 for [90, 90, 180] cells"),
        "{error}"
    );
}

/// An anisotropic BRDF in closed form, smooth enough for coarse tables.
fn brushed(wi: Vec3, wo: Vec3) -> Vec3 {
    let h = (wi + wo).normalize();
    Vec3::new(0.3, 0.2, 0.1) + Vec3::splat(0.5 * (-4.0 * h.x * h.x - 1.0 * h.y * h.y).exp()) * (1.0 + 0.3 * wi.y)
}

fn utia_value(row: usize, column: usize) -> Vec3 {
    let direction = |i: usize| from_angles((15.0 * (i / 48) as f32).to_radians(), (7.5 * (i % 48) as f32).to_radians());
    brushed(direction(row), direction(column))
}

#[test]
fn utia_tables_agree_in_all_their_forms() {
    let dir = tempfile::tempdir().unwrap();
    let all: Vec<Vec3> = (0..288 * 288).map(|i| utia_value(i / 288, i % 288)).collect();
    let planes = (0..3).flat_map(|c| all.iter().flat_map(move |v| f64::from(v[c]).to_le_bytes()));
    fs::write(dir.path().join("x.bin"), planes.collect::<Vec<u8>>()).unwrap();
    let picture = loden::picture::Picture { width: 288, height: 288, rgb: all };
    picture.write(dir.path().join("x.exr")).unwrap();
    picture.clone().scaled(0.8).write(dir.path().join("x.png")).unwrap();
    let [bin, exr, png] = ["x.bin", "x.exr", "x.png"].map(|name| open(dir.path().join(name)));
    for i in 0..300 {
        let (wi, wo) = (from_angles(0.004 * i as f32, 0.7 * i as f32), from_angles(1.3 - 0.004 * i as f32, i as f32));
        let found = eval(bin.as_ref(), wi, wo);
        assert!((found - eval(exr.as_ref(), wi, wo)).abs().max_element() < 1e-6);
        assert!((found * 0.8 - eval(png.as_ref(), wi, wo)).abs().max_element() < 0.01);
        let expected = brushed(wi, wo);
        assert!((found - expected).abs().max_element() < 0.08 * expected.max_element(), "{i} {found} {expected}");
    }
    let (wi, wo) =
        (from_angles(30f32.to_radians(), 15f32.to_radians()), from_angles(60f32.to_radians(), 90f32.to_radians()));
    assert!(
        (eval(bin.as_ref(), wi, wo) - brushed(wi, wo)).abs().max_element() < 1e-4,
        "light and view are not exchanged"
    );
    assert_sampling(bin.as_ref(), "utia");
}

#[test]
fn an_anisotropic_mit_table_has_its_azimuths_right() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.dat");
    let dims = [18usize, 18, 36, 36];
    let mut header = [0i32; 16];
    (0..4).for_each(|i| header[i] = dims[i] as i32);
    (header[6], header[10]) = (1, 3);
    let mut bytes: Vec<u8> = header.iter().flat_map(|v| v.to_le_bytes()).collect();
    for c in 0..3 {
        for i in 0..dims.iter().product::<usize>() {
            let (ti, to, pd, pi) = (i / (18 * 36 * 36), i / (36 * 36) % 18, i / 36 % 36, i % 36);
            let middle = |i: usize, step: f32| ((i as f32 + 0.5) * step).to_radians();
            let wi = from_angles(middle(ti, 5.0), middle(pi, 10.0));
            let wo = from_angles(middle(to, 5.0), middle(pi, 10.0) + middle(pd, 10.0));
            let value = if i == 7 { -1.0 } else { brushed(wi, wo)[c] };
            bytes.extend(value.to_le_bytes());
        }
    }
    fs::write(&path, &bytes).unwrap();
    let brdf = open(&path);
    assert!(brdf.notes().facts.contains(&("missing", "1".into())));
    for i in 0..300 {
        let (wi, wo) =
            (from_angles(0.05 + 0.004 * i as f32, 0.7 * i as f32), from_angles(1.3 - 0.004 * i as f32, i as f32));
        let (found, expected) = (eval(brdf.as_ref(), wi, wo), brushed(wi, wo));
        assert!((found - expected).abs().max_element() < 0.04 * expected.max_element(), "{i} {found} {expected}");
    }
}

#[test]
fn alta_inputs_and_outputs_are_understood() {
    let dir = tempfile::tempdir().unwrap();
    let grid: Vec<(f32, f32, f32)> = (0..12)
        .flat_map(|a| {
            (0..12).flat_map(move |b| (0..12).map(move |c| (a as f32 * 0.12, b as f32 * 0.12, c as f32 * 0.27)))
        })
        .collect();
    let pair = |tl: f32, tv: f32, dphi: f32| (from_angles(tl, dphi), from_angles(tv, 0.0));
    let row = |kind: &str, (tl, tv, dphi): (f32, f32, f32)| {
        let (wi, wo) = pair(tl, tv, dphi);
        let f = closed_form(wi, wo);
        match kind {
            "ISOTROPIC_TV_TL_DPHI" => vec![tv, tl, dphi, f.x, f.y, f.z],
            "ISOTROPIC_TL_TV_PROJ_DPHI" => {
                vec![tl, tv * dphi.cos(), tv * dphi.sin(), dphi, f.x * wo.z, f.y * wo.z, f.z * wo.z]
            }
            _ => vec![tl, dphi, tv, 0.0, f.x, f.y, f.z],
        }
    };
    for kind in ["ISOTROPIC_TV_TL_DPHI", "ISOTROPIC_TL_TV_PROJ_DPHI", "SPHERICAL_TL_PL_TV_PV"] {
        let rows: Vec<Vec<f32>> = grid.iter().map(|&g| row(kind, g)).collect();
        let cosine = if kind == "ISOTROPIC_TL_TV_PROJ_DPHI" { "_COSINE_FACTOR" } else { "" };
        let head = format!("#DIM {} 3\n#PARAM_IN {kind}\n#PARAM_OUT INV_STERADIAN{cosine}\n", rows[0].len() - 3);
        let lines: String =
            rows.iter().map(|r| r.iter().map(|v| v.to_string()).collect::<Vec<_>>().join(" ") + "\n").collect();
        fs::write(dir.path().join("x.dat"), format!("{head}#VS 0\n{lines}")).unwrap();
        let numbers = rows.iter().flatten().flat_map(|&v| f64::from(v).to_le_bytes());
        let binary = format!(
            "#ALTA_BEGIN_HEADER\n{head}#FORMAT binary\n#ENDIAN little\n#SAMPLE_COUNT {}\n#ALTA_END_HEADER\n",
            rows.len()
        );
        fs::write(dir.path().join("y.alta"), binary.into_bytes().into_iter().chain(numbers).collect::<Vec<u8>>())
            .unwrap();
        for name in ["x.dat", "y.alta"] {
            let brdf = open(dir.path().join(name));
            for &(tl, tv, dphi) in grid.iter().step_by(7) {
                let (wi, wo) = pair(tl, tv, dphi);
                let (found, expected) = (eval(brdf.as_ref(), wi, wo), closed_form(wi, wo));
                assert!(
                    (found - expected).abs().max_element() < 2e-3,
                    "{kind} {name} {tl} {tv} {dphi}: {found} {expected}"
                );
            }
        }
    }
    // measured from the mirror side, the same row is half a turn away
    fs::write(dir.path().join("r.dat"), "#DIM 3 1\n#PARAM_IN ISOTROPIC_TV_TL_DPHI\n0.5 0.5 0.0 1.0\n0.5 0.4 1.0 2.0\n")
        .unwrap();
    let turned = open_with(dir.path().join("r.dat"), &Given::from([("phi-from-mirror", "yes")]));
    let sample = turned.samples()[0];
    assert!((sample.wi.x + sample.wo.x).abs() < 1e-6, "mirrored, {sample:?}");
}

#[test]
fn a_spectral_anisotropic_rgl_file_gives_its_spectra() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.bsdf");
    // with uniform densities, the warp is the identity: f cos(theta_o) = spectra(u, v) / (4 sigma)
    let (phis, ones) = ([-3.0f32, -1.0, 1.0, 3.0], |n: usize| floats(&vec![1.0; n]));
    let value = |phi: usize, theta: usize, band: usize, row: usize, column: usize| {
        0.1 + 0.2 * phi as f32 + 0.3 * theta as f32 + 0.5 * band as f32 + 0.1 * row as f32 + 0.05 * column as f32
    };
    let mut spectra = Vec::new();
    for i in 0..4 * 2 * 3 * 2 * 2 {
        spectra.push(value(i / 24, i / 12 % 2, i / 4 % 3, i / 2 % 2, i % 2));
    }
    let fields = [
        ("phi_i", 10, vec![4], floats(&phis)),
        ("theta_i", 10, vec![2], floats(&[0.0, 1.5])),
        ("ndf", 10, vec![2, 2], ones(4)),
        ("sigma", 10, vec![2, 2], floats(&[2.0; 4])),
        ("vndf", 10, vec![4, 2, 3, 3], ones(72)),
        ("luminance", 10, vec![4, 2, 2, 2], ones(32)),
        ("spectra", 10, vec![4, 2, 3, 2, 2], floats(&spectra)),
        ("wavelengths", 10, vec![3], floats(&[450.0, 550.0, 650.0])),
    ];
    fs::write(&path, tensor::file(&fields)).unwrap();
    let brdf = open(&path);
    assert!(!brdf.promises().isotropic);
    assert_eq!(brdf.wavelengths(), [450.0, 550.0, 650.0]);
    for i in 0..50 {
        // not the pole itself, which has no azimuth
        let (theta_i, phi_i) = (0.03 * (i + 1) as f32, -2.9 + 0.11 * i as f32);
        let (wi, wo) = (from_angles(theta_i, phi_i), from_angles(0.4, 2.0 - 0.05 * i as f32));
        let h = (wi + wo).normalize();
        let (u, v) = ((theta(h) * 2.0 / PI).sqrt(), (h.y.atan2(h.x) + PI) / TAU);
        let found = brdf.spectrum(wi, wo);
        for (band, found) in found.iter().enumerate() {
            // every value is linear in its own coordinate
            let expected =
                0.1 + 0.2 * (phi_i + 3.0) / 2.0 + 0.3 * theta_i / 1.5 + 0.5 * band as f32 + 0.1 * v + 0.05 * u;
            let expected = expected / (8.0 * wo.z);
            assert!((found - expected).abs() < 2e-4, "{i} {band}: {found} {expected}");
        }
    }
    let warned = brdf.notes().facts.iter().any(|(name, text)| *name == "rgb" && text.contains("D65"));
    assert!(warned, "{:?}", brdf.notes());
}

#[test]
fn an_rgl_file_of_half_the_azimuths_is_completed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.bsdf");
    let phis: Vec<f32> = (0..5).map(|i| i as f32 / 4.0 * PI - PI).collect();
    let rgb: Vec<f32> = (0..5 * 12).map(|i| 0.2 + 0.1 * (i / 12 % 4) as f32).collect();
    let ones = |n: usize| floats(&vec![1.0; n]);
    // the density of directions is finite at the pole where that of the square vanishes like the area of the square
    let area = |i: usize| {
        let x = (i % 33) as f32 / 32.0;
        x * (FRAC_PI_2 * x * x).sin()
    };
    let vndf: Vec<f32> = (0..5 * 2 * 33).map(area).collect();
    let fields = [
        ("phi_i", 10, vec![5], floats(&phis)),
        ("theta_i", 10, vec![1], floats(&[0.5])),
        ("ndf", 10, vec![2, 2], ones(4)),
        ("sigma", 10, vec![2, 2], ones(4)),
        ("vndf", 10, vec![5, 1, 2, 33], floats(&vndf)),
        ("luminance", 10, vec![5, 1, 2, 2], ones(20)),
        ("rgb", 10, vec![5, 1, 3, 2, 2], floats(&rgb)),
    ];
    fs::write(&path, tensor::file(&fields)).unwrap();
    let brdf = open(&path);
    for i in 0..30 {
        let (wi, wo) = (from_angles(0.5, 0.2 * i as f32), from_angles(0.9, 0.35 * i as f32));
        let turned = |w: Vec3| Vec3::new(-w.x, -w.y, w.z);
        let (a, b) = (eval(brdf.as_ref(), wi, wo), eval(brdf.as_ref(), turned(wi), turned(wo)));
        assert!(a.x > 0.0 && (a - b).abs().max_element() < 1e-5, "{i} {a} {b}");
    }
    assert_sampling(brdf.as_ref(), "half of the azimuths");
}

#[test]
fn the_unpolarised_part_of_a_kaist_file_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.pbsdf");
    // a function linear in each angle; other elements of the matrices hold values that must not be read
    let value = |p: usize, d: usize, h: usize, band: usize| {
        0.2 + 0.1 * band as f32 + 0.05 * h as f32 + 0.02 * d as f32 + if p == 1 { 0.3 } else { 0.0 }
    };
    let mut matrices = Vec::new();
    for i in 0..5 * 3 * 4 * 2 {
        let (p, d, h, band) = (i / 24, i / 8 % 3, i / 2 % 4, i % 2);
        matrices.push(value(p % 4, d, h, band));
        matrices.extend([-7.0; 15]);
    }
    let fields = [
        ("wvls", 3, vec![2], [450u16, 650].iter().flat_map(|v| v.to_le_bytes()).collect()),
        ("M", 10, vec![5, 3, 4, 2, 4, 4], floats(&matrices)),
    ];
    fs::write(&path, tensor::file(&fields)).unwrap();
    let brdf = open(&path);
    assert_eq!(brdf.notes().warnings.len(), 3, "three axes are assumed: {:?}", brdf.notes());
    // at a node: theta_h 30, theta_d 45, phi_d 0 and 90 degrees
    for (phi_d, extra) in [(0.0, 0.0), (FRAC_PI_2, 0.3), (PI, 0.0)] {
        let wd = from_angles(45f32.to_radians(), phi_d);
        let (wi, wo) = HalfDifference { wh: from_angles(30f32.to_radians(), 1.0), wd }.directions();
        let found = eval(brdf.as_ref(), wi, wo);
        // between 450 and 650 nm the spectrum rises from a to a + 0.1, so every channel is in that range
        let low = 0.2 + 0.05 + 0.02 + extra;
        assert!(found.min_element() > low - 0.02 && found.max_element() < low + 0.12, "{phi_d}: {found}");
        assert!(found.x > found.z, "more red than blue: {found}");
        assert_eq!(brdf.wavelengths(), [450.0, 650.0]);
        let spectrum = brdf.spectrum(wi, wo);
        assert!((spectrum[0] - low).abs() < 1e-5 && (spectrum[1] - low - 0.1).abs() < 1e-5, "{spectrum:?} {low}");
    }
}

#[test]
fn astm_files_may_have_one_column_and_no_phi_i() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.astm");
    for (vars, angles) in
        [("theta_i,phi_i,theta_s,phi_s,Integrated", "0.5,0,0.5,3.1"), ("theta_i,theta_r,phi_r,BRDF", "0.5,0.5,3.1")]
    {
        fs::write(&path, format!("VARS {vars}\n\n{angles},0.25\n")).unwrap();
        let brdf = open(&path);
        let found = eval(brdf.as_ref(), from_angles(0.5, 0.0), from_angles(0.5, 3.1));
        assert!((found - Vec3::splat(0.25)).abs().max_element() < 1e-6, "{vars}: {found}");
        assert!(brdf.notes().warnings.iter().any(|w| w.contains("taken as grey")), "{:?}", brdf.notes().warnings);
    }
}

#[test]
fn damaged_text_is_named_by_its_line() {
    let dir = tempfile::tempdir().unwrap();
    let row = "0.1 0 0.2 0 0.5 0.25\n";
    let cases = [
        (format!("2\n500 600\n{row}0.1 0 0.2 0 0.5 x\n"), "line 4: found \"x\", expected a number"),
        (format!("2\n500 600\n{row}0.1 0 0.2 0 0.5\n"), "value: the file ends before it"),
        (format!("2\n500 600\n{row}3.1 0 0.2 0 0.5 0.2\n"), "line 4: found polar angles 3.1"),
        (format!("2\n500 600\n{row}y"), "line 4: found \"y\", expected a number"),
        ("2\n500 600\n".into(), "samples: there are no samples"),
        ("NUM_POINTS 2\nVARS theta_i,phi_i,theta_s,phi_s,500nm\n\n0,0,0,0,1\n".into(), "NUM_POINTS: 1 rows"),
        ("VARS theta_i,phi_i,theta_s,phi_s,500nm\n\n0,0,0,0\n".into(), "line 3: 4 numbers, VARS names 5"),
        ("VARS theta_i,phi_i,theta_s\n".into(), "VARS: no column phi_s"),
        ("#DIM 3 1\n#PARAM_IN NOTHING\n".into(), "#PARAM_IN NOTHING is not supported"),
        ("#DIM 9 1\n#PARAM_IN RUSIN_TH_TD_PD\n".into(), "#DIM: found [9, 1]"),
    ];
    for (text, expected) in cases {
        let path = dir.path().join("x.txt");
        fs::write(&path, &text).unwrap();
        let error = import::open_named(&path, &Default::default()).err().unwrap().to_string();
        assert!(error.contains("x.txt: ") && error.contains(expected), "{text}\n{error}\nshould contain {expected}");
    }
}
