//! Drawings: the lens with its rays, and the plots of a report.
//!
//! A [`Figure`] is a list of lines and texts with a size in points; it writes itself as SVG, and front ends may paint it as pixels.

mod chart;
mod coating;
mod conjugates;
mod figure;
mod ghosts;
mod glass_map;
mod histogram;
mod layout;
mod plots;
mod thin;

pub use chart::{Axis, Chart, Line, Style};
pub use coating::{ReflectanceCurve, coating_plot};
pub use conjugates::conjugates_figure;
pub use figure::{Anchor, Color, Figure, INK, Item};
pub use ghosts::{DrawnGhost, ghost_plot};
pub use glass_map::glass_map;
pub use histogram::{Distributed, distribution_plot};
pub use layout::{LayoutOptions, layout};
pub use plots::{
    PointImageCurves, color_plot, distortion_plot, fan_plot, mtf_over_plot, mtf_plot, psf_plot, spot_plot, through_focus_plot,
    vignetting_plot, wavelength_color, zernike_plot,
};
pub use thin::thin_layout;
