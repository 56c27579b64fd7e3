//! Orientation of pictures.

/// How a stored picture is turned upright: by the numbers 1 to 8 of TIFF and EXIF.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Orientation {
    /// Whether rows of the stored picture are columns of the upright one.
    swaps_axes: bool,
    /// Whether the result, after that, is mirrored left to right.
    mirrors_x: bool,
    /// Whether it is mirrored top to bottom.
    mirrors_y: bool,
}

impl Orientation {
    pub(super) const UPRIGHT: Self = Self::new(false, false, false);

    pub(super) const fn new(swaps_axes: bool, mirrors_x: bool, mirrors_y: bool) -> Self {
        Self { swaps_axes, mirrors_x, mirrors_y }
    }

    /// By the number of the tag `Orientation`.
    pub(super) fn of_tag(number: u64) -> Option<Self> {
        Some(match number {
            1 => Self::UPRIGHT,
            2 => Self::new(false, true, false),
            3 => Self::new(false, true, true),
            4 => Self::new(false, false, true),
            5 => Self::new(true, false, false),
            6 => Self::new(true, true, false),
            7 => Self::new(true, true, true),
            8 => Self::new(true, false, true),
            _ => return None,
        })
    }

    /// Width and height of the upright picture.
    pub(super) fn size(self, width: usize, height: usize) -> [usize; 2] {
        if self.swaps_axes { [height, width] } else { [width, height] }
    }

    /// Turns `width` x `height` pixels of three numbers upright; returns the new width and height.
    pub(super) fn apply<T: Copy + Default>(self, width: usize, height: usize, numbers: &mut Vec<T>) -> [usize; 2] {
        if self == Self::UPRIGHT {
            return [width, height];
        }
        let [new_width, new_height] = self.size(width, height);
        let mut upright = Vec::with_capacity(numbers.len());
        for y in 0..new_height {
            for x in 0..new_width {
                let x = if self.mirrors_x { new_width - 1 - x } else { x };
                let y = if self.mirrors_y { new_height - 1 - y } else { y };
                let [x, y] = if self.swaps_axes { [y, x] } else { [x, y] };
                upright.extend_from_slice(&numbers[3 * (y * width + x)..][..3]);
            }
        }
        *numbers = upright;
        [new_width, new_height]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_orientations_are_turned_upright() {
        // stored rows: abc, def
        for (tag, width, expected) in [
            (1, 3, "abcdef"),
            (2, 3, "cbafed"),
            (3, 3, "fedcba"),
            (4, 3, "defabc"),
            (5, 2, "adbecf"),
            (6, 2, "daebfc"),
            (7, 2, "fcebda"),
            (8, 2, "cfbead"),
        ] {
            let mut numbers: Vec<u8> = "abcdef".bytes().flat_map(|b| [b; 3]).collect();
            let size = Orientation::of_tag(tag).unwrap().apply(3, 2, &mut numbers);
            let found: String = numbers.chunks_exact(3).map(|c| char::from(c[0])).collect();
            assert_eq!((found.as_str(), size), (expected, [width, 6 / width]), "{tag}");
        }
        assert_eq!(Orientation::of_tag(0), None);
    }
}
