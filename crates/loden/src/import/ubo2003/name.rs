//! Directions in file names.

/// Light and view of one image, (polar angle, azimuth) in degrees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pair {
    pub light: [f64; 2],
    pub view: [f64; 2],
}

/// Finds the four numbers with the keys `tl`, `pl`, `tv`, `pv` in the base name of `path`, in any order.
pub(super) fn parse(path: &str) -> Result<Pair, String> {
    let base = path.rsplit(['/', '\\']).next().unwrap_or(path);
    let stem = base.rsplit_once('.').map_or(base, |(stem, _)| stem);
    let find = |key: &str| {
        let mut numbers = (0..stem.len()).filter_map(|at| number_after(key, stem, at));
        match (numbers.next(), numbers.next()) {
            (Some(number), None) => Ok(number),
            (Some(_), Some(_)) => Err(format!("`{key}` occurs more than once in the name")),
            _ => Err(format!(
                "no `{key}` followed by an angle in the name; expected a name like `00008 tl015 pl060 tv030 pv030.jpg`"
            )),
        }
    };
    let angles = |theta: &str, phi: &str| {
        let (t, p) = (find(theta)?, find(phi)?);
        if !(0.0..=90.0).contains(&t) || !(-360.0..=360.0).contains(&p) {
            return Err(format!("found {t} and {p} for `{theta}` and `{phi}`, expected 0..90 and -360..360 degrees"));
        }
        Ok([t, p])
    };
    Ok(Pair { light: angles("tl", "pl")?, view: angles("tv", "pv")? })
}

/// The number after `key`, if the word at byte `at` of `text` consists of that key and a number.
fn number_after(key: &str, text: &str, at: usize) -> Option<f64> {
    let (before, word) = text.split_at_checked(at)?;
    if before.ends_with(char::is_alphanumeric) || !word.get(..key.len())?.eq_ignore_ascii_case(key) {
        return None;
    }
    let number = &word[key.len()..];
    let digits = number.strip_prefix('-').unwrap_or(number);
    let end = digits.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(digits.len());
    if digits[end..].starts_with(char::is_alphanumeric) {
        return None;
    }
    number[..number.len() - digits.len() + end].trim_end_matches('.').parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_known_spelling_is_read() {
        let names = [
            "UBO2003/MANYFILES/tv030_pv090/00008 tl015 pl060 tv030 pv090.jpg",
            "img_tv30_pv90_tl15_pl60.jpg",
            "TL015.0-PL060 tv030_pv090.PNG",
            "tv30.0_pv90.0_tl15.0_pl60.0.png",
        ];
        for name in names {
            assert_eq!(parse(name), Ok(Pair { light: [15.0, 60.0], view: [30.0, 90.0] }), "{name}");
        }
        assert_eq!(parse("tl7.5 pl0 tv0 pv0.jpg").unwrap().light, [7.5, 0.0]);
    }

    #[test]
    fn bad_names_say_what_is_wrong() {
        assert!(parse("00008 tl015 pl060 tv030.jpg").unwrap_err().contains("`pv`"));
        assert!(parse("tl015 pl060 tv030 pv030 tl015.jpg").unwrap_err().contains("more than once"));
        assert!(parse("tl095 pl060 tv030 pv030.jpg").unwrap_err().contains("95"));
        assert!(parse("tlx pl060 tv030 pv030.jpg").is_err());
        assert!(parse("tl0ä pl060 tv030 pv030.jpg").is_err() && parse("ä").is_err() && parse("").is_err());
    }
}
