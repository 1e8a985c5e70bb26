//! The Cornell box, with its measured spectra.
//!
//! Geometry and spectra: Cornell University Program of Computer Graphics, "Cornell Box Data" (mm, here metres;
//! reflectances at 400–700 nm in 4 nm; the lamp at 400, 500, 600, 700 nm: 0, 8, 15.6, 18.4 relative). The lamp's absolute
//! luminance is ours: 3000 cd/m². It hangs 0.5 mm below the ceiling, whose plane it shares in the data.

use crate::material::{Material, Scattering};
use crate::scene::{CameraProjection, Description, FilmHints, Object, Shape, Viewpoint};
use crate::shape::{Mesh, Quad};
use crate::texture::Color;
use diopter_light::Spectrum;
use diopter_light::spectrum::Table;
use glam::{Affine3A, Mat3A, Vec3, Vec3A};

const REFLECTANCE_CSV: &str = include_str!("cornell_box_reflectance.csv");
/// cd/m²
const LAMP_LUMINANCE: f32 = 3000.0;
const LAMP: [(f32, f32); 4] = [(400.0, 0.0), (500.0, 8.0), (600.0, 15.6), (700.0, 18.4)];

/// Corners of each face, mm, four a face.
const WHITE: &[[[f32; 3]; 4]] = &[
    [[552.8, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 559.2], [549.6, 0.0, 559.2]],
    [[556.0, 548.8, 0.0], [556.0, 548.8, 559.2], [0.0, 548.8, 559.2], [0.0, 548.8, 0.0]],
    [[549.6, 0.0, 559.2], [0.0, 0.0, 559.2], [0.0, 548.8, 559.2], [556.0, 548.8, 559.2]],
    // Short block.
    [[130.0, 165.0, 65.0], [82.0, 165.0, 225.0], [240.0, 165.0, 272.0], [290.0, 165.0, 114.0]],
    [[290.0, 0.0, 114.0], [290.0, 165.0, 114.0], [240.0, 165.0, 272.0], [240.0, 0.0, 272.0]],
    [[130.0, 0.0, 65.0], [130.0, 165.0, 65.0], [290.0, 165.0, 114.0], [290.0, 0.0, 114.0]],
    [[82.0, 0.0, 225.0], [82.0, 165.0, 225.0], [130.0, 165.0, 65.0], [130.0, 0.0, 65.0]],
    [[240.0, 0.0, 272.0], [240.0, 165.0, 272.0], [82.0, 165.0, 225.0], [82.0, 0.0, 225.0]],
    // Tall block.
    [[423.0, 330.0, 247.0], [265.0, 330.0, 296.0], [314.0, 330.0, 456.0], [472.0, 330.0, 406.0]],
    [[423.0, 0.0, 247.0], [423.0, 330.0, 247.0], [472.0, 330.0, 406.0], [472.0, 0.0, 406.0]],
    [[472.0, 0.0, 406.0], [472.0, 330.0, 406.0], [314.0, 330.0, 456.0], [314.0, 0.0, 456.0]],
    [[314.0, 0.0, 456.0], [314.0, 330.0, 456.0], [265.0, 330.0, 296.0], [265.0, 0.0, 296.0]],
    [[265.0, 0.0, 296.0], [265.0, 330.0, 296.0], [423.0, 330.0, 247.0], [423.0, 0.0, 247.0]],
];
const GREEN: &[[[f32; 3]; 4]] = &[[[0.0, 0.0, 559.2], [0.0, 0.0, 0.0], [0.0, 548.8, 0.0], [0.0, 548.8, 559.2]]];
const RED: &[[[f32; 3]; 4]] = &[[[552.8, 0.0, 0.0], [549.6, 0.0, 559.2], [556.0, 548.8, 559.2], [556.0, 548.8, 0.0]]];

/// The box, its lamp and its camera (35 mm lens on 25 × 25 mm).
pub fn description() -> Description {
    let (_, rows) = {
        let complete: String = REFLECTANCE_CSV
            .lines()
            .filter(|l| !l.starts_with('#'))
            .map(|l| l.rsplit_once(',').map_or(l, |(cells, _)| cells).to_owned() + "\n")
            .collect();
        diopter_light::cie::tables::read_csv(&complete)
    };
    let reflectance = |column: usize| {
        let points: Vec<(f32, f32)> = rows.iter().map(|r| (r[0] as f32, r[column] as f32)).collect();
        Color::spectrum(Spectrum::Table(Table::from_points(&points)))
    };
    let lamp = Table::from_points(&LAMP);
    let luminance = diopter_light::color::luminance(|nm| lamp.at(nm)) as f32;
    let material = |name: &str, column: usize| Material::new(name, Scattering::Diffuse(reflectance(column)));
    let object = |name: &str, mesh: u32, material: u32| {
        Object::new(name, Shape::Mesh { mesh, world_from_mesh: Affine3A::IDENTITY }, material)
    };
    let lamp_quad =
        Quad { corner: Vec3::new(0.213, 0.5483, 0.227), edges: [Vec3::new(0.130, 0.0, 0.0), Vec3::new(0.0, 0.0, 0.105)] };
    Description {
        name: "cornell".into(),
        meshes: [WHITE, RED, GREEN].map(|m| faces(m).into()).to_vec(),
        materials: vec![
            material("white", 2),
            material("red", 3),
            material("green", 4),
            Material {
                // The lamp reflects 78 % (same source).
                scattering: Scattering::Diffuse(Color::spectrum(Spectrum::Constant(0.78))),
                ..Material::lamp("lamp", Spectrum::Table(lamp.scaled(LAMP_LUMINANCE / luminance)))
            },
        ],
        objects: vec![
            object("white walls and blocks", 0, 0),
            object("red wall", 1, 1),
            object("green wall", 2, 2),
            Object::new("lamp", Shape::Quad(lamp_quad), 3),
        ],
        cameras: vec![Viewpoint {
            name: "Cornell".into(),
            // At (278, 273, −800) mm looking along +z, x to the left.
            world_from_camera: Affine3A {
                matrix3: Mat3A::from_cols(Vec3A::NEG_X, Vec3A::Y, Vec3A::NEG_Z),
                translation: Vec3A::new(0.278, 0.273, -0.8),
            },
            sight: CameraProjection::Perspective { vertical_fov: 2.0 * (12.5f32 / 35.0).atan() },
            lens: None,
            film: FilmHints::default(),
            node: None,
        }],
        ..Default::default()
    }
}

fn faces(faces: &[[[f32; 3]; 4]]) -> Mesh {
    let mut mesh = Mesh::default();
    for face in faces {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(face.iter().map(|p| Vec3::from_array(*p) / 1000.0));
        mesh.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    mesh
}
