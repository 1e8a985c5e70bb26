//! Parts of a picture: development asks for rectangles and works on them one at a time, so that memory does not grow with the picture.

/// A rectangle of pixels; it may reach beyond the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    /// First column.
    pub left: i64,
    /// First row.
    pub top: i64,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Region {
    /// A whole picture.
    pub fn whole(width: usize, height: usize) -> Self {
        Region { left: 0, top: 0, width, height }
    }

    /// With so many pixels more on each side.
    pub fn grown(self, by: usize) -> Self {
        let shift = by as i64;
        Region { left: self.left - shift, top: self.top - shift, width: self.width + 2 * by, height: self.height + 2 * by }
    }

    /// Column after the last.
    pub fn right(self) -> i64 {
        self.left + self.width as i64
    }

    /// Row after the last.
    pub fn bottom(self) -> i64 {
        self.top + self.height as i64
    }

    /// Pixels.
    pub fn area(self) -> usize {
        self.width * self.height
    }
}

/// Channels of a region, a plane each: `planes[channel][row * width + column]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes {
    /// Where it lies.
    pub region: Region,
    /// The channels.
    pub planes: Vec<Vec<f32>>,
}

impl Planes {
    /// The part inside a smaller region, which must lie inside this one: that is not checked.
    pub fn cut(self, to: Region) -> Planes {
        if to == self.region {
            return self;
        }
        let planes = self.planes.iter().map(|p| cut(p, self.region, to)).collect();
        Planes { region: to, planes }
    }
}

/// The part of a plane inside a smaller region; `to` must lie inside `from`: that is not checked.
pub fn cut(plane: &[f32], from: Region, to: Region) -> Vec<f32> {
    let (x, y) = ((to.left - from.left) as usize, (to.top - from.top) as usize);
    let mut part = Vec::with_capacity(to.area());
    for row in y..y + to.height {
        part.extend_from_slice(&plane[row * from.width + x..][..to.width]);
    }
    part
}

/// Index inside 0..n of one that may lie outside. Reflected at the edge pixel, which keeps the phase of patterns of period 2; other
/// patterns are continued by whole periods.
pub fn inside(i: i64, n: usize, period: usize) -> usize {
    let size = n as i64;
    if (0..size).contains(&i) {
        return i as usize;
    }
    if period <= 2 {
        if size == 1 {
            return 0;
        }
        let i = i.rem_euclid(2 * (size - 1));
        return (if i < size { i } else { 2 * (size - 1) - i }) as usize;
    }
    // The nearest place of the same phase; a picture smaller than a period has none for some phases.
    let p = period as i64;
    let phase = i.rem_euclid(p);
    let last = size - 1 - (size - 1 - phase).rem_euclid(p);
    let nearest = if i < 0 { phase } else { last };
    nearest.clamp(0, size - 1) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outside_pixels_keep_the_phase_of_the_pattern() {
        for i in -20..40i64 {
            assert_eq!(inside(i, 13, 2) as i64 % 2, i.rem_euclid(2) % 2, "{i}");
            assert_eq!(inside(i, 13, 6) as i64 % 6, i.rem_euclid(6), "{i}");
            assert!(inside(i, 1, 2) == 0 && inside(i, 2, 6) < 2);
        }
    }
}
