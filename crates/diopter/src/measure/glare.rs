//! The veiling glare index of a photograph (ISO 9358, integral method): a black spot on an extended bright field, light in its image over light beside it.
//!
//! The spot lies in the middle of the picture unless somebody says where. A spot of matter is never quite black, and a raw file's black level is taken as it
//! is written: both add to the index. In focus the image of the spot's edge is blurred: only the inner part is measured.

use super::{MeasureError, Plane, Region};
use serde::Serialize;

/// Part of the spot's width that is measured.
const INNER: f64 = 0.4;
/// Fewest pixels across it.
const FEWEST: usize = 8;
/// Dark is what is darker than this part of the brightest of the row and column through the middle.
const DARK: f64 = 0.5;

/// Glare in a picture.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Glare {
    /// Light in the spot over that beside it.
    pub index: f64,
    /// Standard error of the index, from the scatter of the pixels.
    pub error: f64,
    /// The part of the spot that was measured.
    pub spot: Region,
    /// Means of spot and surround, in the unit of the plane.
    pub means: [f64; 2],
}

/// Measures a spot; `spot`: the black part of it, found about the middle of the picture without. Fails below 32 pixels a side, without a spot, and where the field beside
/// it is too narrow, clipped, or less than twice as bright.
pub fn measure(plane: &Plane, spot: Option<Region>) -> Result<Glare, MeasureError> {
    plane.check(plane.whole(), 4 * FEWEST)?;
    let found = match spot {
        Some(region) => region,
        None => find(plane)?,
    };
    plane.check(found, 2)?;
    let shrunk = |from: usize, size: usize| {
        let margin = (size as f64 * 0.5 * (1.0 - INNER)) as usize;
        (from + margin, (size - 2 * margin).max(1))
    };
    let (x, width) = if spot.is_some() { (found.x, found.width) } else { shrunk(found.x, found.width) };
    let (y, height) = if spot.is_some() { (found.y, found.height) } else { shrunk(found.y, found.height) };
    let inner = Region { x, y, width, height };
    // Left and right of the spot, as far from its edge as it is wide.
    let left = found.x.checked_sub(2 * found.width);
    let right = Some(found.x + 2 * found.width).filter(|x| x + found.width <= plane.width);
    let beside = [left, right].into_iter().flatten().map(|x| Region { x, ..found });
    let [mut sum, mut count] = [0.0; 2];
    for region in beside {
        if plane.clipped(region)[1] > 0.0 {
            return Err(MeasureError::unfit(
                region.to_string(),
                "values that are clipped",
                "a shorter exposure: glare is told relative to the surround",
            ));
        }
        for v in plane.samples(region) {
            sum += v;
            count += 1.0;
        }
    }
    let values: Vec<f64> = plane.samples(inner).collect();
    let n = values.len() as f64;
    if count == 0.0 || n < 2.0 {
        let found = format!("a spot of {}x{} pixels", found.width, found.height);
        return Err(MeasureError::unfit(
            "picture",
            found,
            "a spot with at least twice its width of bright field to the left or right",
        ));
    }
    let (dark, bright) = (values.iter().sum::<f64>() / n, sum / count);
    if !(bright > 0.0 && dark < DARK * bright) {
        let what = format!("{dark:.4} in the spot, {bright:.4} beside it");
        return Err(MeasureError::unfit(inner.to_string(), what, "a black spot on a bright field, such as the scene glare-spot"));
    }
    let variance = values.iter().map(|v| (v - dark).powi(2)).sum::<f64>() / (n - 1.0);
    Ok(Glare { index: dark / bright, error: (variance / n).sqrt() / bright, spot: inner, means: [dark, bright] })
}

/// The dark part of row and column through the middle.
fn find(plane: &Plane) -> Result<Region, MeasureError> {
    let (column, row) = (plane.width / 2, plane.height / 2);
    // Some rows and columns: mosaics have gaps, and single pixels noise.
    let mean = |x: usize, y: usize, width: usize, height: usize| {
        let samples: Vec<f64> = plane.samples(Region { x, y, width, height }).collect();
        samples.iter().sum::<f64>() / samples.len().max(1) as f64
    };
    let across: Vec<f64> = (0..plane.width - 3).map(|x| mean(x, row - 2, 4, 4)).collect();
    let down: Vec<f64> = (0..plane.height - 3).map(|y| mean(column - 2, y, 4, 4)).collect();
    let most = across.iter().chain(&down).copied().fold(0.0, f64::max);
    let range = |line: &[f64], middle: usize| {
        let dark = |i: &usize| line[*i] < DARK * most;
        let first = (0..=middle).rev().take_while(dark).last()?;
        let last = (middle..line.len()).take_while(dark).last()?;
        (first > 0 && last + 1 < line.len() && last + 1 - first >= FEWEST).then_some((first + 2, last + 1 - first))
    };
    let found = range(&across, column - 2).zip(range(&down, row - 2));
    let Some(((x, width), (y, height))) = found else {
        let expected = "a black spot there, with bright field around it; say where it is by --region";
        return Err(MeasureError::unfit("middle of the picture", "no black spot", expected));
    };
    Ok(Region { x, y, width, height })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spot(noise: f32) -> Plane {
        let value = |i: usize| {
            let (x, y) = (i % 120, i / 120);
            let dark = (50..70).contains(&x) && (30..50).contains(&y);
            let jitter = noise * (((i * 7919) % 97) as f32 / 48.0 - 1.0);
            if dark { 3.0 + jitter } else { 100.0 + jitter }
        };
        Plane {
            width: 120,
            height: 80,
            values: (0..120 * 80).map(value).collect(),
            limits: [f32::NEG_INFINITY, 200.0],
            clipped: None,
        }
    }

    #[test]
    fn a_spot_of_three_percent_is_found_and_told() {
        let found = measure(&spot(0.0), None).unwrap();
        assert!((found.index - 0.03).abs() < 1e-9, "{found:?}");
        assert!(found.spot.x >= 50 && found.spot.x + found.spot.width <= 70 && found.spot.y >= 30, "{found:?}");
        let noisy = measure(&spot(1.0), None).unwrap();
        assert!((noisy.index - 0.03).abs() < 4.0 * noisy.error && noisy.error > 1e-4, "{noisy:?}");
        let told = measure(&spot(0.0), Some(Region { x: 55, y: 35, width: 8, height: 8 })).unwrap();
        assert_eq!((told.spot.x, told.index), (55, found.index));
    }

    #[test]
    fn pictures_without_a_spot_are_refused() {
        let even = Plane { values: vec![100.0; 120 * 80], ..spot(0.0) };
        assert!(measure(&even, None).unwrap_err().to_string().contains("no black spot"));
        let clipped = Plane { limits: [f32::NEG_INFINITY, 100.0], ..spot(0.0) };
        assert!(measure(&clipped, None).unwrap_err().to_string().contains("clipped"));
    }
}
