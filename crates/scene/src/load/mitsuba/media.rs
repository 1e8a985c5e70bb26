//! Media: homogeneous ones, and those that grids of numbers fill. Source: Mitsuba 3, `homogeneous`, `heterogeneous`, `gridvolume`, `constvolume` and the layout of
//! `.vol` files (VolumeGrid); phase functions isotropic and Henyey-Greenstein.
//!
//! Extinction and albedo are multiplied at the nodes of the extinction's grid (of the albedo's, where only that is a grid), trilinear between; at the border the
//! outermost nodes go on. Filters other than trilinear are left out.

use super::context::Context;
use super::tree::Node;
use super::values::{self, Shade, boolean, number, transform};
use super::wrong;
use crate::SceneError;
use crate::bvh::Bounds;
use crate::medium::{Coefficient, Field, Grid, Medium, Scalars, Tint, Volume, VolumePlace, trilinear};
use glam::{Affine3A, DMat4, DVec3, IVec3, Vec3};
use std::sync::Arc;

type Read<T> = Result<T, SceneError>;

/// Largest value of a grid.
const MOST: f32 = 1e30;

/// A medium.
pub(super) fn of(context: &mut Context, node: &Arc<Node>) -> Read<Medium> {
    let scale = number(node, "scale", 1.0)?.max(0.0) as f32;
    let asymmetry = match context.nested(node, "phase", None)? {
        Some(phase) if phase.kind() == "hg" => number(&phase, "g", 0.8)?.clamp(-0.999, 0.999) as f32,
        Some(phase) if phase.kind() != "isotropic" => {
            phase.leave_out();
            context.skip_unsupported(format!("phase \"{}\": light is thrown evenly", phase.kind()));
            0.0
        }
        _ => 0.0,
    };
    let bare = Medium { name: node.get("id").unwrap_or("medium").to_owned(), asymmetry, emission: None, ..Medium::default() };
    match node.kind() {
        "homogeneous" => {
            let mut rgb = |name: &str, default: f32| match filling(context, node, name)? {
                None => Ok(Vec3::splat(default)),
                Some(Source::Even(rgb)) => Ok(rgb),
                Some(Source::Grid(_)) => {
                    Err(wrong(node, format!("a grid as \"{name}\""), "one value: a heterogeneous medium has grids"))
                }
            };
            // Mitsuba 0.x names either both or extinction and albedo.
            let (absorption, scattering) = match (node.child("sigma_a"), node.child("sigma_s")) {
                (None, None) => {
                    let (sigma_t, albedo) = (rgb("sigma_t", 1.0)?, rgb("albedo", 0.75)?.min(Vec3::ONE));
                    (sigma_t * (Vec3::ONE - albedo), sigma_t * albedo)
                }
                _ => (rgb("sigma_a", 0.0)?, rgb("sigma_s", 0.0)?),
            };
            Ok(Medium { absorption: coefficient(absorption, scale), scattering: coefficient(scattering, scale), ..bare })
        }
        "heterogeneous" => heterogeneous(context, node, bare, scale),
        other => Err(wrong(node, format!("medium \"{other}\""), "homogeneous or heterogeneous")),
    }
}

/// A coefficient of a colour, 1/m; what is grey is so at all wavelengths.
fn coefficient(rgb: Vec3, scale: f32) -> Coefficient {
    if rgb == Vec3::splat(rgb.x) { Coefficient::grey(rgb.x * scale) } else { Coefficient::from_rgb(rgb, scale) }
}

/// What a coefficient is from place to place.
enum Source {
    Even(Vec3),
    Grid(Box<GridVolume>),
}

impl Source {
    /// At a place of the world.
    fn at(&self, p: DVec3) -> Vec3 {
        match self {
            Source::Even(rgb) => *rgb,
            Source::Grid(grid) => grid.at(grid.unit_from_world.transform_point3(p)),
        }
    }

    fn grid(&self) -> Option<&GridVolume> {
        if let Source::Grid(grid) = self { Some(grid) } else { None }
    }
}

/// A grid over the unit cube.
struct GridVolume {
    size: [usize; 3],
    /// Red, green, blue; x runs first. All the same of a grid of one channel.
    values: Vec<Vec3>,
    is_grey: bool,
    world_from_unit: DMat4,
    unit_from_world: DMat4,
}

impl GridVolume {
    /// Trilinear between the middles of cells, going on beyond the outermost.
    fn at(&self, p: DVec3) -> Vec3 {
        let size = IVec3::from_array(self.size.map(|n| n as i32));
        let cell = p * size.as_dvec3() - 0.5;
        let base = cell.floor();
        let value = |at: IVec3| {
            let [x, y, z] = at.clamp(IVec3::ZERO, size - 1).to_array().map(|v| v as usize);
            Some(self.values[(z * self.size[1] + y) * self.size[0] + x])
        };
        trilinear(base.as_ivec3(), (cell - base).as_vec3(), Vec3::ZERO, value)
    }
}

fn heterogeneous(context: &mut Context, node: &Arc<Node>, bare: Medium, scale: f32) -> Read<Medium> {
    let sigma_t = filling(context, node, "sigma_t")?.unwrap_or(Source::Even(Vec3::ONE));
    let albedo = filling(context, node, "albedo")?.unwrap_or(Source::Even(Vec3::splat(0.75)));
    if sigma_t.grid().is_none() && albedo.grid().is_some() {
        context.skip_unsupported("extinction beyond the grid of the albedo");
    }
    let Some(grid) = sigma_t.grid().or(albedo.grid()) else {
        let (Source::Even(sigma_t), Source::Even(albedo)) = (&sigma_t, &albedo) else { unreachable!("neither is a grid") };
        return Ok(Medium {
            absorption: coefficient(*sigma_t * (Vec3::ONE - *albedo), scale),
            scattering: coefficient(*sigma_t * *albedo, scale),
            ..bare
        });
    };
    // One cell more on each side, so that what lies between the outermost middles and the border goes on as they are.
    let size = grid.size.map(|n| n + 2);
    let cell = Vec3::from_array(grid.size.map(|n| 1.0 / n as f32));
    let bounds = Bounds { min: -cell, max: Vec3::ONE + cell };
    let nodes = || {
        (0..size[0] * size[1] * size[2]).map(|i| {
            let at = [i % size[0], i / size[0] % size[1], i / (size[0] * size[1])];
            let unit = DVec3::from_array(std::array::from_fn(|k| (at[k] as f64 - 0.5) / grid.size[k] as f64));
            grid.world_from_unit.transform_point3(unit.clamp(DVec3::ZERO, DVec3::ONE))
        })
    };
    let place = Affine3A::from_mat4(grid.world_from_unit.as_mat4());
    let place =
        VolumePlace::still(place).ok_or_else(|| wrong(node, "a volume without extent", "a to_world that can be inverted"))?;
    let unit = Bounds { min: Vec3::ZERO, max: Vec3::ONE };
    let filled = |field, absorption, scattering| {
        let volume = Some(Box::new(Volume::new(place, unit, field, None)));
        Medium { absorption, scattering, volume, ..bare.clone() }
    };
    if let (Some(true), Source::Even(albedo)) = (sigma_t.grid().map(|g| g.is_grey), &albedo) {
        let density = nodes().map(|p| sigma_t.at(p).x).collect();
        let grid = Grid::new(size, density, &bounds).expect("a value for each node");
        let field = Field::Density(Scalars::Grid(grid));
        return Ok(filled(field, coefficient(Vec3::ONE - *albedo, scale), coefficient(*albedo, scale)));
    }
    let tints = |of: &dyn Fn(Vec3, Vec3) -> Vec3| {
        let values = nodes().map(|p| Tint::from_rgb(of(sigma_t.at(p), albedo.at(p).clamp(Vec3::ZERO, Vec3::ONE)))).collect();
        Grid::new(size, values, &bounds)
    };
    let field = Field::Colors { absorption: tints(&|t, a| t * (Vec3::ONE - a)), scattering: tints(&|t, a| t * a) };
    Ok(filled(field, Coefficient::grey(scale), Coefficient::grey(scale)))
}

/// A coefficient by name.
fn filling(context: &mut Context, node: &Arc<Node>, name: &str) -> Read<Option<Source>> {
    let Some(child) = node.child(name) else { return Ok(None) };
    if let Some(shade) = Shade::of(child)? {
        return Ok(Some(Source::Even(shade.rgb().max(Vec3::ZERO))));
    }
    let volume = context.resolved(child)?;
    match volume.kind() {
        "constvolume" => Ok(Some(Source::Even(values::shade(&volume, "value")?.map_or(Vec3::ONE, |s| s.rgb()).max(Vec3::ZERO)))),
        "gridvolume" => {
            let file = values::text(&volume, "filename")
                .ok_or_else(|| wrong(&volume, "a gridvolume without filename", "<string name=\"filename\" .../>"))?;
            let bytes = (context.fetch)(file).map_err(|e| wrong(&volume, format!("{file}: {e}"), "a file that can be read"))?;
            let (size, channels, own, values) =
                vol(&bytes).map_err(|e| wrong(&volume, format!("{file}: {e}"), "a .vol file of floats"))?;
            // Numbers of grids are taken as they are.
            boolean(&volume, "raw", true)?;
            let mut world_from_unit = transform(&volume, "to_world")?;
            if boolean(&volume, "use_grid_bbox", false)? {
                let extent = own[1] - own[0];
                world_from_unit *= DMat4::from_translation(own[0]) * DMat4::from_scale(extent);
            }
            for (name, ours) in [("filter_type", "trilinear"), ("wrap_mode", "clamp")] {
                if values::text(&volume, name).is_some_and(|said| said != ours) {
                    context.skip_unsupported(format!("{name} of gridvolumes other than {ours}"));
                }
            }
            let is_finite = world_from_unit.is_finite() && world_from_unit.inverse().is_finite();
            if !(is_finite && world_from_unit.determinant().abs() > 0.0) {
                return Err(wrong(&volume, "a volume without extent", "a to_world that can be inverted"));
            }
            let values = match channels {
                1 => values.iter().map(|v| Vec3::splat(*v)).collect(),
                _ => values.chunks_exact(3).map(Vec3::from_slice).collect(),
            };
            let unit_from_world = world_from_unit.inverse();
            Ok(Some(Source::Grid(Box::new(GridVolume {
                size,
                values,
                is_grey: channels == 1,
                world_from_unit,
                unit_from_world,
            }))))
        }
        other => Err(wrong(&volume, format!("volume \"{other}\""), "gridvolume or constvolume")),
    }
}

/// Size, channels, corners of the box, and numbers of a file.
type Vol = ([usize; 3], usize, [DVec3; 2], Vec<f32>);

/// Reads a `.vol` file: "VOL", version 3, a type (1: 32-bit floats), counts along x, y, z, channels, the box's corners, the numbers.
fn vol(bytes: &[u8]) -> Result<Vol, String> {
    const HEADER: usize = 48;
    let Some(rest) = bytes.strip_prefix(b"VOL") else { return Err("it does not begin with VOL".to_owned()) };
    let (Some(3), Some(header), Some(data)) = (rest.first(), bytes.get(4..HEADER), bytes.get(HEADER..)) else {
        return Err("it is of another version than 3, or cut short".to_owned());
    };
    let words = header.as_chunks::<4>().0;
    let whole = |i: usize| i32::from_le_bytes(words[i]);
    let real = |i: usize| f64::from(f32::from_le_bytes(words[i]));
    if whole(0) != 1 {
        return Err(format!("numbers of type {}: 32-bit floats (1) are read", whole(0)));
    }
    let counts: [usize; 3] = std::array::from_fn(|i| usize::try_from(whole(1 + i)).unwrap_or(0));
    let channels = match whole(4) {
        n @ (1 | 3) => n as usize,
        other => return Err(format!("{other} channels: 1 or 3 are read")),
    };
    let all = counts.iter().try_fold(4 * channels, |all, n| all.checked_mul(*n));
    if counts.contains(&0) || all != Some(data.len()) {
        return Err(format!(
            "{} bytes for {} × {} × {} values of {channels} numbers",
            data.len(),
            counts[0],
            counts[1],
            counts[2]
        ));
    }
    let values: Vec<f32> = data.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    if let Some(bad) = values.iter().find(|v| !(0.0..=MOST).contains(*v)) {
        return Err(format!("a value of {bad}: expected numbers from 0 to {MOST:e}"));
    }
    let corners = [DVec3::new(real(5), real(6), real(7)), DVec3::new(real(8), real(9), real(10))];
    Ok((counts, channels, corners, values))
}
