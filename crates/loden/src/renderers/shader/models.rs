//! Analytic BRDFs of single texels.

use std::fmt::Write;
use std::path::Path;

use crate::codec::parts::model_layout;
use crate::{Error, Result};

/// A model that can be exported: its functions, and the BRDF as an expression of its parameters, for a number of lobes.
struct Known {
    name: &'static str,
    source: &'static str,
    value: fn(usize) -> String,
}

const KNOWN: &[Known] = &[
    Known { name: "lambert", source: "", value: |_| "kd / PI".into() },
    Known {
        name: "oren-nayar",
        source: include_str!("brdf/oren_nayar.glsl"),
        value: |_| "kd * oren_nayar(sigma, wi, wo)".into(),
    },
    Known {
        name: "phong",
        source: include_str!("brdf/phong.glsl"),
        value: |_| "kd / PI + ks * phong_lobe(exponent, wi, wo)".into(),
    },
    Known {
        name: "blinn-phong",
        source: include_str!("brdf/blinn_phong.glsl"),
        value: |_| "kd / PI + ks * blinn_phong_lobe(exponent, wi, wo)".into(),
    },
    Known { name: "lafortune", source: include_str!("brdf/lafortune.glsl"), value: lafortune },
    Known {
        name: "ward",
        source: include_str!("brdf/ward.glsl"),
        value: |_| "kd / PI + ks * ward_lobe(alpha_x, alpha_y, wi, wo)".into(),
    },
];

fn lafortune(lobes: usize) -> String {
    let lobe = |k: usize| {
        let end = if k == 1 { String::new() } else { format!("_{k}") };
        format!(" + ks{end} * lafortune_lobe(vec3(cx{end}, cy{end}, cz{end}), exponent{end}, wi, wo)")
    };
    "kd / PI".to_owned() + &(1..=lobes).map(lobe).collect::<String>()
}

/// The names of the models that can be exported.
pub(super) fn names() -> Vec<&'static str> {
    KNOWN.iter().map(|known| known.name).collect()
}

fn known(path: &Path, name: &str) -> Result<&'static Known> {
    let problem = || format!("each texel has the analytic BRDF {name}; shaders have only {}", names().join(", "));
    KNOWN.iter().find(|known| known.name == name).ok_or_else(|| Error::unsupported(path, problem()))
}

/// Checks that a model can be exported.
///
/// # Errors
/// [`Error::Unsupported`].
pub(super) fn check(path: &Path, name: &str) -> Result<()> {
    known(path, name).map(drop)
}

/// The functions of a model whose parameters are at an address, and a call that gives pi times the BRDF of a texel.
///
/// # Errors
/// [`Error::Unsupported`].
pub(super) fn model(path: &Path, name: &str, lobes: usize, grain: bool, address: usize) -> Result<(String, String)> {
    let known = known(path, name)?;
    let layout = model_layout(name, lobes, grain)?;
    let count = layout.numbers.len() + 3 * layout.colors.len();
    let groups = count.div_ceil(4);
    let dashed = |name: &str| name.replace('-', "_");
    let mut body: String =
        (0..groups).map(|g| format!("    vec4 numbers_{g} = number({address} + {groups} * texel + {g});\n")).collect();
    let number = |k: usize| format!("numbers_{}.{}", k / 4, ["x", "y", "z", "w"][k % 4]);
    for (k, (name, least, most)) in layout.numbers.iter().enumerate() {
        let _ = writeln!(body, "    float {} = clamp({}, {least:?}, {most:?});", dashed(name), number(k));
    }
    for (name, other) in layout.ties.iter().filter(|(name, _)| known.uses(name, lobes)) {
        let _ = writeln!(body, "    float {} = {};", dashed(name), dashed(other));
    }
    for (k, (name, most)) in layout.colors.iter().enumerate() {
        let [r, g, b] = [0, 1, 2].map(|channel| number(layout.numbers.len() + 3 * k + channel));
        let _ = writeln!(body, "    vec3 {} = clamp(vec3({r}, {g}, {b}), vec3(0.0), vec3({most:?}));", dashed(name));
    }
    let value = (known.value)(lobes);
    let function = format!("model_{address}");
    let source = format!(
        "{}\n// Pi times the BRDF of a texel.\nvec3 {function}(int texel, vec3 wi, vec3 wo) {{\n{body}    return min(PI * max({value}, vec3(0.0)), vec3(1000000000.0));\n}}\n\n",
        known.source
    );
    Ok((source, format!("{function}(texel, wi, wo)")))
}

impl Known {
    /// Whether its value has a parameter.
    fn uses(&self, name: &str, lobes: usize) -> bool {
        let (value, name) = ((self.value)(lobes), name.replace('-', "_"));
        value.split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == name)
    }
}
