//! Meshes of a prim with one material each, and the primvars on them.

use super::bending::{Bending, VertexBending};
use super::layer::{Key, Value};
use super::material_binding::Bound;
use super::stage::{Prim, Stage};
use crate::SceneError;
use crate::shape::Mesh;
use crate::texture::Scalar;
use std::sync::Arc;

/// A set of faces with one material.
pub struct Part {
    /// The subset; none of what no subset holds.
    pub subset: Option<Arc<Prim>>,
    pub material: u32,
    /// Names of the primvars of texture coordinates.
    pub uvs: Vec<String>,
    /// Whether it has colours of its own.
    pub colors: bool,
    /// Heights of its material.
    pub displacement: Option<Arc<Scalar>>,
}

impl Part {
    /// A part of a mesh: all of it, or a subset of its faces.
    pub fn new(subset: Option<Arc<Prim>>, bound: &Bound) -> Self {
        let Bound { number, uvs, colors, displacement } = bound.clone();
        Part { subset, material: number, uvs, colors, displacement }
    }
}

/// A mesh with one material.
pub struct MeshPart {
    pub mesh: Mesh,
    pub material: u32,
    /// What bends it.
    pub bending: Option<VertexBending>,
    /// Heights that are to move its points.
    pub displacement: Option<Arc<Scalar>>,
}

/// Meshes of a prim with their materials.
#[derive(Default)]
pub struct Meshes {
    pub parts: Vec<MeshPart>,
    /// For each part, if any is displaced, what it was before.
    pub before: Vec<Option<Arc<Mesh>>>,
    /// What was left out of them.
    pub left_out: Vec<&'static str>,
}

/// To what a value of a primvar belongs.
#[derive(Clone, Copy, PartialEq)]
pub enum Per {
    Mesh,
    Face,
    Point,
    Corner,
}

/// A primvar: `width` numbers each.
pub struct Primvar {
    pub per: Per,
    /// Of points: whether it is interpolated linearly even where the surface is smooth.
    pub is_varying: bool,
    width: usize,
    values: Arc<[f32]>,
    indices: Option<Arc<[i32]>>,
}

impl Primvar {
    /// Values at a corner of a face, by how the primvar is interpolated.
    pub fn at(&self, face: usize, point: usize, corner: usize) -> &[f32] {
        let i = match self.per {
            Per::Mesh => 0,
            Per::Face => face,
            Per::Point => point,
            Per::Corner => corner,
        };
        let i = self.indices.as_ref().map_or(i, |indices| indices[i] as usize);
        &self.values[i * self.width..(i + 1) * self.width]
    }
}

/// Faces, points and corners of a mesh.
pub struct Size {
    pub faces: usize,
    pub points: usize,
    pub corners: usize,
}

/// Faces as a file says them.
pub struct Control {
    pub points: Vec<[f32; 3]>,
    pub indices: Arc<[i32]>,
    /// Where the corners of each face begin, and where the last one's end.
    pub starts: Vec<usize>,
    pub size: Size,
    /// Whether outside is where corners run clockwise.
    pub left_handed: bool,
    /// Number of the part of each face; none of holes and of what is no face.
    pub part_of: Vec<Option<u32>>,
    /// What bends its points.
    pub bending: Option<Bending>,
}

/// A primvar by name, `width` numbers a value; `Some(None)` where it is not there, `None` where it does not fit the mesh. Fails where a value is damaged in its file.
pub fn primvar(
    stage: &Stage,
    prim: &Prim,
    name: &str,
    width: usize,
    size: &Size,
    default: &str,
) -> Result<Option<Option<Primvar>>, SceneError> {
    let Some(values) = stage.value(prim, name)?.and_then(|v| v.floats()) else { return Ok(Some(None)) };
    // Coordinates may have a third number, which pictures do not ask for.
    let kind = stage.property_field(prim, name, Key::TypeName)?;
    let has_three = width == 2 && kind.as_ref().and_then(Value::text).is_some_and(|t| t.starts_with("texCoord3"));
    let values = if has_three { values.as_chunks::<3>().0.iter().flat_map(|v| [v[0], v[1]]).collect() } else { values };
    let indices = stage.value(prim, &format!("{name}:indices"))?.and_then(|v| v.ints()).filter(|i| !i.is_empty());
    let there = values.len() / width;
    let count = indices.as_ref().map_or(there, |i| i.len());
    let said = stage.property_field(prim, name, Key::Interpolation)?;
    let said = said.as_ref().and_then(Value::text).map(|t| t.to_string());
    let per = match said.as_deref() {
        Some("constant") => Per::Mesh,
        Some("uniform") => Per::Face,
        Some("vertex" | "varying") => Per::Point,
        Some("faceVarying") => Per::Corner,
        // Where nothing is said, the number of values tells.
        _ if count == size.corners && count != size.points => Per::Corner,
        _ if count == size.points => Per::Point,
        _ if count == size.faces => Per::Face,
        _ if default == "vertex" => Per::Point,
        _ => Per::Mesh,
    };
    let needed = match per {
        Per::Mesh => 1,
        Per::Face => size.faces,
        Per::Point => size.points,
        Per::Corner => size.corners,
    };
    let in_range = indices.as_ref().is_none_or(|all| all.iter().all(|i| usize::try_from(*i).is_ok_and(|i| i < there)));
    if count < needed || !in_range {
        return Ok(None);
    }
    let is_varying = said.as_deref() == Some("varying");
    Ok(Some(Some(Primvar { per, is_varying, width, values, indices })))
}
