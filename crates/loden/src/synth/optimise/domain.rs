//! The texels of the exemplar as places to copy from.

use super::super::Source;

/// Where sources may be: a rectangle, which wraps for periodic exemplars.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::synth) struct Domain {
    pub width: usize,
    pub height: usize,
    pub periodic: bool,
}

impl Domain {
    #[inline(always)]
    pub(in crate::synth) fn index(&self, source: Source) -> usize {
        usize::from(source.y) * self.width + usize::from(source.x)
    }

    /// The texel at an offset; none beyond the edge, or within `margin` of it. The offset is at most the size.
    #[inline(always)]
    pub(in crate::synth) fn shifted(&self, source: Source, dx: i32, dy: i32, margin: i32) -> Option<Source> {
        let (w, h) = (self.width as i32, self.height as i32);
        let (x, y) = (i32::from(source.x) + dx, i32::from(source.y) + dy);
        if self.periodic {
            return Some(Source { x: wrapped(x, w) as u16, y: wrapped(y, h) as u16 });
        }
        let inside = x >= margin && y >= margin && x < w - margin && y < h - margin;
        inside.then_some(Source { x: x as u16, y: y as u16 })
    }

    /// The texel at an offset, or the nearest one with `margin` to the edge.
    #[inline(always)]
    pub(in crate::synth) fn clamped(&self, source: Source, dx: i32, dy: i32, margin: i32) -> Source {
        let (w, h) = (self.width as i32, self.height as i32);
        let (x, y) = (i32::from(source.x) + dx, i32::from(source.y) + dy);
        if self.periodic {
            return Source { x: wrapped(x, w) as u16, y: wrapped(y, h) as u16 };
        }
        Source { x: x.clamp(margin, w - 1 - margin) as u16, y: y.clamp(margin, h - 1 - margin) as u16 }
    }
}

#[inline(always)]
fn wrapped(x: i32, n: i32) -> i32 {
    if (0..n).contains(&x) { x } else { x.rem_euclid(n) }
}
