//! Charts of fields in rows and columns, found by their four outer corners.

use super::MeasureError;
use super::fit::least_squares;

/// Four outer corners of the fields of a chart in a picture, pixels: upper left, upper right, lower right, lower left.
pub type Corners = [[f64; 2]; 4];

/// Where an embedded chart lies in a picture of 3:2 that is framed by itself: its width and height are these `fractions` of the picture's.
pub(super) fn framed(chart: &str, fractions: [f64; 2], [width, height]: [usize; 2]) -> Result<Corners, MeasureError> {
    let (w, h) = (width as f64, height as f64);
    if (w / h / 1.5 - 1.0).abs() > 0.03 {
        return Err(MeasureError::unfit(
            chart,
            format!("a picture of {width} × {height} pixels, not 3:2 as the embedded chart is framed"),
            "--corners with the four outer corners of the patches",
        ));
    }
    let [x, y] = [0.5 * fractions[0] * w, 0.5 * fractions[1] * h];
    Ok([[-x, -y], [x, -y], [x, y], [-x, y]].map(|[a, b]| [0.5 * w + a, 0.5 * h + b]))
}

/// The projective map of the unit square to four corners (upper left, upper right, lower right, lower left).
pub(super) fn projective(corners: Corners) -> Option<impl Fn([f64; 2]) -> [f64; 2]> {
    let size = corners.iter().flatten().fold(1.0f64, |a, b| a.max(b.abs()));
    let unit = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let rows = unit.iter().zip(&corners).flat_map(|([u, v], [x, y])| {
        let [x, y] = [x / size, y / size];
        [(vec![*u, *v, 1.0, 0.0, 0.0, 0.0, -u * x, -v * x], x), (vec![0.0, 0.0, 0.0, *u, *v, 1.0, -u * y, -v * y], y)]
    });
    let h = least_squares(rows, 8)?;
    Some(move |[u, v]: [f64; 2]| {
        let w = (h[6] * u + h[7] * v + 1.0) / size;
        [(h[0] * u + h[1] * v + h[2]) / w, (h[3] * u + h[4] * v + h[5]) / w]
    })
}
