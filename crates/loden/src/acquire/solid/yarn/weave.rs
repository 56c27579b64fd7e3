//! Which yarn is on top.

crate::words! {
    /// The interlacing of warp and weft.
    pub enum Weave { Plain = "plain", Twill = "twill", Basket = "basket", Satin = "satin" }
}

impl Weave {
    /// The number of yarns after which the weave repeats.
    pub(super) fn repeat(self) -> i32 {
        match self {
            Self::Plain => 2,
            Self::Twill | Self::Basket => 4,
            Self::Satin => 8,
        }
    }

    /// Whether warp `i` is above weft `j`.
    fn is_warp_above(self, i: i32, j: i32) -> bool {
        match self {
            Self::Plain => (i + j) % 2 == 0,
            Self::Twill => (i + j) % 4 < 2,
            Self::Basket => (i / 2 + j / 2) % 2 == 0,
            Self::Satin => (3 * i + j) % 8 != 0,
        }
    }

    /// 1 if a yarn is above its crossing `j`, else -1.
    pub(super) fn level(self, warp: bool, yarn: i32, j: i32) -> f32 {
        let above = if warp { self.is_warp_above(yarn, j) } else { !self.is_warp_above(j, yarn) };
        if above { 1.0 } else { -1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_every_crossing_one_yarn_is_above_and_every_yarn_interlaces() {
        for weave in [Weave::Plain, Weave::Twill, Weave::Basket, Weave::Satin] {
            let n = weave.repeat();
            for i in 0..n {
                for j in 0..n {
                    assert_eq!(weave.level(true, i, j), -weave.level(false, j, i));
                    assert_eq!(weave.level(true, i, j), weave.level(true, i + n, j));
                }
                for warp in [true, false] {
                    let levels: Vec<f32> = (0..n).map(|j| weave.level(warp, i, j)).collect();
                    assert!(levels.contains(&1.0) && levels.contains(&-1.0), "{weave} {i} {levels:?}");
                }
            }
        }
    }
}
