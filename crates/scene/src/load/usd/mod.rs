//! USD into a [`Description`]: `.usda`, `.usdc` and `.usdz`, in the subset that exporters write.
//!
//! `text` and `binary` read layers, `package` finds them in archives, `stage` composes them into prims. From there on `walk` goes over the prims, and
//! `transform`, `geometry`, `skeleton`, `material`, `light` and `camera` make of each what it is. What is left out is told once, with counts. Files are
//! opened by the caller: `fetch` gets names that count from the folder of the main file.
//!
//! Units: `metersPerUnit` and `upAxis` of the stage make metres with +Y up. A light of intensity 1 has 1 cd/m² (UsdLux). Values hold at
//! `startTimeCode`, which is the scene's time 0; transforms follow their time samples.
//!
//! Source: OpenUSD 25 (schemas UsdGeom, UsdShade, UsdLux, UsdPreviewSurface specification 2.6).

mod bending;
mod binary;
mod camera;
mod collections;
mod curves;
mod geometry;
mod instancer;
mod layer;
mod light;
mod material;
mod material_binding;
mod mesh_parts;
mod package;
mod skeleton;
mod skeleton_binding;
mod stage;
mod subdivision;
mod text;
mod transform;
mod walk;
mod world;

#[cfg(test)]
mod material_tests;
#[cfg(test)]
mod skeleton_tests;
#[cfg(test)]
mod tests;

use crate::SceneError;
use crate::load::{Fetch, finished};
use crate::scene::Description;

fn error(place: &str, found: impl Into<String>, expected: impl Into<String>) -> SceneError {
    SceneError::File { place: place.to_owned(), found: found.into(), expected: format!("expected {}", expected.into()) }
}

/// Reads a scene. `name` stands for the main file in messages; `fetch` gets files by the names in it. Fails where a layer is damaged, of another version or no USD,
/// references go round or too deep, `metersPerUnit` is not 1e-9 to 1e9, or nothing that is drawn has a surface. Layers and pictures that are missing are warnings.
pub fn load(bytes: Vec<u8>, name: &str, fetch: Fetch) -> Result<Description, SceneError> {
    let description = world::World::new(bytes, name, fetch)?.run()?;
    let warnings = description.warnings.clone();
    let expected = "a Mesh, a Sphere or another solid that is drawn (purpose \"default\" or \"render\", visible)";
    finished(description, name, expected).map_err(|e| match e {
        // What was left out is likely what was to be seen.
        SceneError::File { place, found, expected } => {
            let all = warnings.iter().map(|w| w.strip_prefix(&format!("{name}: ")).unwrap_or(w));
            let found = all.fold(found, |found, w| format!("{found}; {}", w.replace(world::SHOWN_WITHOUT, "")));
            SceneError::File { place, found, expected }
        }
        other => other,
    })
}
