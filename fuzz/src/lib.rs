//! What a lens or a scene that was read must be able to do.

use diopter_lens::import::{Format, read};
use diopter_lens::paraxial::FirstOrder;
use diopter_lens::ray::{Apertures, TraceDirection, TracedRay};
use diopter_lens::{Prescription, PrescriptionError, State, System};
use diopter_scene::{Description, Scene, SceneError};

/// Traces a ray, takes the first order, writes the lens and reads it back.
pub fn lens(read_lens: Result<Prescription, PrescriptionError>) {
    let Ok(p) = read_lens else { return };
    let system = System::at(&p, State::default());
    let n = system.indices(550.0);
    let _ = FirstOrder::of(&system, &n);
    let mut ray = TracedRay { position: Default::default(), direction: Default::default() };
    (ray.position.y, ray.direction.z) = (0.5, 1.0);
    let _ = system.trace(ray, &n, TraceDirection::ToFilm, Apertures::Clip);
    let text = p.to_toml();
    if let Err(e) = read(text.as_bytes(), Format::Toml, "again") {
        panic!("a lens that was read cannot be written and read again: {e}\n{text}");
    }
}

/// Builds a scene. Large ones are slow to build, not different.
pub fn scene(read: Result<Description, SceneError>) {
    let Ok(description) = read else { return };
    let triangles: usize = description.meshes.iter().map(|m| m.triangles.len()).sum();
    if triangles < 1 << 16 && description.objects.len() < 256 {
        let _ = Scene::build(description);
    }
}
