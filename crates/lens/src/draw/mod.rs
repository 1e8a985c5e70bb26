//! Drawings: the lens with its rays, and what plots are made of: sheets, charts with axes and lines. The plot of an analysis is in the file of the
//! analysis ([`crate::analysis`]).
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
mod thin;

pub use chart::{Axis, Chart, Line, Style};
pub use coating::{ReflectanceCurve, coating_plot};
pub use conjugates::conjugates_figure;
pub(crate) use figure::FIELD_COLORS;
pub use figure::{Anchor, Color, Figure, INK, Item, wavelength_color};
pub use ghosts::{DrawnGhost, ghost_plot};
pub use glass_map::glass_map;
pub use histogram::{Distributed, distribution_plot};
pub use layout::{LayoutOptions, layout};
pub use thin::thin_layout;
