//! Colour differences of the 24 ColorChecker patches in a developed picture.
//!
//! The patches lie in a grid of 6 × 4 that is found by its four outer corners (a projective map, so that the chart may be seen at an angle), or by
//! the framing of the embedded chart. Of each the middle half is averaged, in linear light. The reference is the patch's reflectance under the
//! light of the chart (CIE 1931 observer), adapted to D65 by Bradford: what a developed picture means to show. Exposure is not a matter of colour:
//! the picture is scaled so that the six grey patches have their luminance in the least-squares sense. Differences are CIEDE2000 in CIELAB of D65.

use super::corners::{Corners, projective};
use super::{MeasureError, Measured};
use diopter_light::cie;
use diopter_light::color::{RgbSpace, bradford, delta_e_2000, lab, xy_from_xyz, xyz_from_xy, xyz_of};
use glam::DVec3;
use serde::Serialize;

/// Columns and rows of the chart.
const GRID: [usize; 2] = [6, 4];
/// Side of a patch over the step to the next, as in the embedded chart.
const FILL: f64 = 0.04 / 0.044;
/// Width and height of the outer corners of the embedded chart over those of its picture, as it is framed: 0.26 × 0.172 m at 0.95 m before 100 mm on
/// 36 × 24 mm, focused there.
const FRAMED: [f64; 2] = [0.8497, 0.8432];
/// Fraction of a patch's side that is averaged.
const MIDDLE: f64 = 0.5;
/// Largest standard deviation within a patch, of the light of the chart's white.
const MOST_UNEVEN: f64 = 0.08;
/// The lightness of patches correlates with the chart's at least as much, however they are lit and developed; patches of other things, or of a chart upside down, do not.
const LEAST_LIKENESS: f64 = 0.7;
/// Largest factor that the greys of a chart may be below what they should be: ten stops.
const DARKEST_SCALE: f64 = 1e3;
/// Part of a patch from which on it counts as clipped, and the least number of grey patches that the exposure is told by.
const MOST_CLIPPED: f64 = 0.01;
const LEAST_GREYS: usize = 3;

/// A patch as it is and as it should be.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Patch {
    /// Its name on the chart.
    pub name: String,
    /// CIELAB (D65) measured.
    pub lab: [f64; 3],
    /// Its reference.
    pub reference: [f64; 3],
    /// CIEDE2000 between them.
    pub delta_e: f64,
    /// Standard deviation of the luminance within it, relative to white.
    pub uneven: f64,
    /// Whether the picture is clipped there: it counts in neither the scale nor the differences of all.
    pub clipped: bool,
}

/// The chart.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ColorDifferences {
    /// Dark skin first, black last.
    pub patches: Vec<Patch>,
    /// What the picture was multiplied by.
    pub scale: f64,
    /// Mean of the differences of all that are not clipped.
    pub mean: f64,
    /// The largest of them.
    pub largest: f64,
}

/// Where the embedded chart lies in a picture of 3:2 that is framed by itself: dark skin in the upper left. Fails on another shape (by more than 3 %).
pub fn framed(size: [usize; 2]) -> Result<Corners, MeasureError> {
    super::corners::framed("colour chart", FRAMED, size)
}

/// XYZ of the patches under an illuminant, adapted to D65, a perfect white having Y = 1.
fn references(light: &str) -> Result<Vec<(String, DVec3)>, MeasureError> {
    let table = cie::illuminant(light).ok_or_else(|| {
        MeasureError::unfit("light", format!("\"{light}\""), format!("one of {}", cie::illuminant_names().join(", ")))
    })?;
    // As the chart is lit: nothing beyond the visible.
    let lit = |nm: f32| if (380.0..=780.0).contains(&nm) { table.at(nm) } else { 0.0 };
    let white = xyz_of(lit);
    let d65 = RgbSpace::Srgb.chromaticities().1;
    let adapted = bradford(xy_from_xyz(white), d65);
    let patches = cie::colorchecker();
    Ok(patches.into_iter().map(|p| (p.name.clone(), adapted * xyz_of(|nm| p.reflectance.at(nm) * lit(nm)) / white.y)).collect())
}

/// Measures the chart in a developed picture of linear sRGB. `corners`: outer corners of the patches, pixels; the framing of the embedded chart
/// without. `light`: what lights the chart (`D65`, `A` ...). Fails on what is no developed picture of R, G and B, on an unknown `light`, on corners outside the picture
/// or three in line, and where the patches are black, uneven or not as light and dark as the chart's, and
/// where fewer than three grey ones are below white.
pub fn measure(picture: &Measured, corners: Option<Corners>, light: &str) -> Result<ColorDifferences, MeasureError> {
    let Measured::Light { pixels, bands, limits, clipped, facts: None } = picture else {
        return Err(MeasureError::unfit(
            "colour chart",
            "a raw image or a focal plane",
            "a developed picture (.png, .tif, .jpg, .exr): `diopter develop` it first",
        ));
    };
    if bands != &["R", "G", "B"] {
        return Err(MeasureError::unfit("colour chart", format!("channels {}", bands.join(", ")), "R, G, B"));
    }
    let corners = corners.map_or_else(|| framed([pixels.width, pixels.height]), Ok)?;
    let to_picture = projective(corners)
        .ok_or_else(|| MeasureError::unfit("corners", format!("{corners:?}"), "four corners of which no three are in line"))?;
    let references = references(light)?;
    let xyz_from_rgb = RgbSpace::Srgb.xyz_from_rgb();
    // Extent of the grid in steps from patch to patch.
    let extent = GRID.map(|n| n as f64 - 1.0 + FILL);
    let mut seen = Vec::with_capacity(24);
    for k in 0..24 {
        let middle = [(k % GRID[0]) as f64 + 0.5 * FILL, (k / GRID[0]) as f64 + 0.5 * FILL];
        let (mut sum, mut squares, mut count, mut at_limit) = (DVec3::ZERO, 0.0, 0.0, 0.0);
        const STEPS: usize = 24;
        for i in 0..STEPS * STEPS {
            let within = [i % STEPS, i / STEPS].map(|s| ((s as f64 + 0.5) / STEPS as f64 - 0.5) * MIDDLE * FILL);
            let [x, y] = to_picture([0, 1].map(|a| (middle[a] + within[a]) / extent[a]));
            if !(x >= 0.0 && y >= 0.0 && x < pixels.width as f64 && y < pixels.height as f64) {
                return Err(MeasureError::unfit(
                    "colour chart",
                    format!("patch \"{}\" at {x:.0},{y:.0} lies outside the picture", references[k].0),
                    "the four outer corners of its patches within the picture",
                ));
            }
            let p = pixels.pixel(x as usize, y as usize);
            let is_clipped = match clipped {
                Some((clipped, _)) => clipped[y as usize * pixels.width + x as usize],
                None => p.iter().any(|v| *v >= limits[1]),
            };
            at_limit += f64::from(is_clipped);
            let xyz = xyz_from_rgb * DVec3::new(p[0].into(), p[1].into(), p[2].into());
            sum += xyz;
            squares += xyz.y * xyz.y;
            count += 1.0;
        }
        let mean = sum / count;
        seen.push((mean, (squares / count - mean.y * mean.y).max(0.0).sqrt(), at_limit > MOST_CLIPPED * count));
    }
    // The last row is grey.
    let greys: Vec<usize> = (18..24).filter(|k| !seen[*k].2).collect();
    if greys.len() < LEAST_GREYS {
        return Err(MeasureError::unfit(
            "colour chart",
            format!("{} of its six grey patches are clipped to white", 6 - greys.len()),
            "a picture of less exposure",
        ));
    }
    let product = greys.iter().map(|k| seen[*k].0.y * references[*k].1.y).sum::<f64>();
    let scale = product / greys.iter().map(|k| seen[*k].0.y.powi(2)).sum::<f64>();
    if !(scale.is_finite() && scale > 0.0 && scale < DARKEST_SCALE) {
        return Err(MeasureError::unfit(
            "colour chart",
            "its grey patches are black or nearly so",
            "a chart that is lit, and its corners",
        ));
    }
    let white = xyz_from_xy(RgbSpace::Srgb.chromaticities().1);
    let patches: Vec<Patch> = seen
        .into_iter()
        .zip(references)
        .map(|((xyz, deviation, clipped), (name, reference))| {
            let [found, wanted] = [xyz * scale, reference].map(|c| lab(c, white));
            let delta_e = delta_e_2000(found, wanted);
            Patch { name, lab: found.to_array(), reference: wanted.to_array(), delta_e, uneven: deviation * scale, clipped }
        })
        .collect();
    if let Some(p) = patches.iter().find(|p| p.uneven > MOST_UNEVEN) {
        return Err(MeasureError::unfit(
            "colour chart",
            format!("patch \"{}\" is not even (its luminance deviates by {:.0} % of white)", p.name, 100.0 * p.uneven),
            "the four outer corners of its patches, dark skin in the upper left: --corners x,y,x,y,x,y,x,y",
        ));
    }
    let likeness = correlation(patches.iter().filter(|p| !p.clipped).map(|p| (p.reference[0], p.lab[0])));
    if likeness < LEAST_LIKENESS {
        return Err(MeasureError::unfit(
            "colour chart",
            format!("patches whose lightness does not follow the chart's (correlation {likeness:.2}, of a chart 1)"),
            "the four outer corners of its patches, dark skin in the upper left: --corners x,y,x,y,x,y,x,y",
        ));
    }
    let counted = || patches.iter().filter(|p| !p.clipped).map(|p| p.delta_e);
    let mean = counted().sum::<f64>() / counted().count() as f64;
    let largest = counted().fold(0.0, f64::max);
    Ok(ColorDifferences { patches, scale, mean, largest })
}

/// Pearson's coefficient of pairs; 0 where one of both does not vary.
fn correlation(pairs: impl Iterator<Item = (f64, f64)> + Clone) -> f64 {
    let n = pairs.clone().count() as f64;
    let mean = pairs.clone().fold([0.0; 2], |m, p| [m[0] + p.0 / n, m[1] + p.1 / n]);
    let [ab, aa, bb] = pairs.fold([0.0; 3], |s, p| {
        let (a, b) = (p.0 - mean[0], p.1 - mean[1]);
        [s[0] + a * b, s[1] + a * a, s[2] + b * b]
    });
    if aa * bb > 0.0 { ab / (aa * bb).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use diopter_image::Raster;

    /// The reference itself as a picture, with patches changed by a function of their number.
    fn chart(corners: Corners, change: impl Fn(usize, DVec3) -> DVec3) -> Measured {
        let (width, height) = (300, 200);
        let mut pixels = Raster::new(width, height, 3);
        let to_picture = projective(corners).unwrap();
        let rgb_from_xyz = RgbSpace::Srgb.xyz_from_rgb().inverse();
        let extent = GRID.map(|n| n as f64 - 1.0 + FILL);
        for (k, (_, xyz)) in references("D65").unwrap().into_iter().enumerate() {
            let rgb = rgb_from_xyz * change(k, xyz) * 0.37;
            const STEPS: usize = 120;
            for i in 0..STEPS * STEPS {
                let within = [i % STEPS, i / STEPS].map(|s| (s as f64 + 0.5) / STEPS as f64 * FILL);
                let at = [(k % GRID[0]) as f64 + within[0], (k / GRID[0]) as f64 + within[1]];
                let [x, y] = to_picture([at[0] / extent[0], at[1] / extent[1]]);
                pixels.pixel_mut(x as usize, y as usize).copy_from_slice(&rgb.to_array().map(|v| v as f32));
            }
        }
        let bands = ["R", "G", "B"].map(str::to_owned).to_vec();
        Measured::Light { pixels, bands, limits: [f32::NEG_INFINITY, f32::INFINITY], clipped: None, facts: None }
    }

    #[test]
    fn the_reference_itself_has_no_differences() {
        let tilted = [[20.0, 30.0], [270.0, 15.0], [285.0, 190.0], [30.0, 170.0]];
        for corners in [framed([300, 200]).unwrap(), tilted] {
            let found = measure(&chart(corners, |_, xyz| xyz), Some(corners), "D65").unwrap();
            // Numbers of 32 bits leave 1e-5.
            assert!(found.largest < 1e-3 && (found.scale * 0.37 - 1.0).abs() < 1e-6, "{} {}", found.largest, found.scale);
        }
        assert!(measure(&chart(framed([300, 200]).unwrap(), |_, xyz| xyz), None, "D65").unwrap().largest < 1e-3);
    }

    #[test]
    fn a_changed_patch_is_the_one_that_differs() {
        let corners = framed([300, 200]).unwrap();
        // Number 14 is red: its X raised by a tenth.
        let picture = chart(corners, |k, xyz| if k == 14 { DVec3::new(1.1 * xyz.x, xyz.y, xyz.z) } else { xyz });
        let found = measure(&picture, None, "D65").unwrap();
        let p = &found.patches[14];
        let wanted = delta_e_2000(DVec3::from_array(p.lab), DVec3::from_array(p.reference));
        assert!(p.delta_e > 2.0 && p.delta_e == wanted && found.largest == p.delta_e, "{p:?}");
        assert!(found.patches.iter().enumerate().all(|(k, p)| k == 14 || p.delta_e < 1e-3));
        assert!((found.mean * 24.0 - p.delta_e).abs() < 0.03);
    }

    #[test]
    fn wrong_places_and_lights_are_named() {
        let corners = framed([300, 200]).unwrap();
        let picture = chart(corners, |_, xyz| xyz);
        let told = |corners: Option<Corners>, light: &str| measure(&picture, corners, light).unwrap_err().to_string();
        assert!(told(None, "D64").contains("D65"));
        assert!(told(Some(corners.map(|[x, y]| [x + 27.0, y])), "D65").contains("not even"));
        assert!(told(Some(corners.map(|[x, y]| [x + 200.0, y])), "D65").contains("outside"));
        assert!(told(Some([[1.0, 1.0]; 4]), "D65").contains("in line"));
        assert!(framed([200, 200]).is_err());
    }
}
