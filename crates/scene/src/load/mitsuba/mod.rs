//! Mitsuba's scenes (`.xml`, of versions 3 and 0.x) into a [`Description`], in the subset that its gallery uses.
//!
//! `tree` reads the files with `default`, `include` and `$name`; `values` numbers, colours and transforms; `shapes`, `materials`, `media`, `lights` and
//! `camera` make of objects what they are, by a `context` of files, references and what is left out; `world` puts them together. Plugins that are not known are an error where a picture would be wrong, and
//! are counted where it is only simpler. Files are opened by the caller.
//!
//! Units: a scene unit is a metre; a radiance of 1 is 1 cd/m², so pictures in cd/m² are Mitsuba's RGB.
//!
//! Source: W. Jakob et al., Mitsuba 3 documentation (plugin reference) and its behaviour (mitsuba 3.7).

mod camera;
mod context;
mod curves;
mod lights;
mod materials;
mod media;
mod metals;
mod shapes;
mod tree;
mod values;
mod world;

use crate::SceneError;
use crate::load::{Fetch, finished};
use crate::scene::Description;
use tree::Node;

/// An error at a node.
fn wrong(node: &Node, found: impl Into<String>, expected: impl Into<String>) -> SceneError {
    SceneError::File {
        place: format!("{}: line {}", node.file, node.line),
        found: found.into(),
        expected: format!("expected {}", expected.into()),
    }
}

/// Reads a scene. `name` stands for the main file in messages; `fetch` gets files by the names in it. Fails with the file and line where XML or a value is damaged, a
/// file that is included or a mesh cannot be had, a plugin is not known that a picture would be wrong without, or nothing has a surface.
pub fn load(bytes: &[u8], name: &str, fetch: Fetch) -> Result<Description, SceneError> {
    let (root, folders) = tree::read(bytes, name, fetch)?;
    let find = |name: &str| tree::found(fetch, &folders, name);
    let description = world::World::new(name, &find, &root).run(&root)?;
    finished(description, name, "a shape of the scene")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light::PunctualKind;
    use crate::material::{Coverage, Interior, Scattering};
    use crate::scene::{CameraProjection, Shape};
    use crate::texture::Scalar;
    use glam::{Vec2, Vec3};

    fn fetch(name: &str) -> Result<Vec<u8>, String> {
        match name {
            "t.obj" => Ok(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 0.75\nf 1/1 2/2 3/3\n".to_vec()),
            // A roof of two faces; a group of a triangle without texture coordinates, and a line.
            "roof.obj" => Ok(b"v 0 0 0\nv 1 0 0\nv 1 1 1\nv 0 1 1\nv 1 2 0\nv 0 2 0\nvt 0 0\nvt 1 1\ng a\nf 1/1 2/2 3/2 4/1\nf 4/1 3/2 5/2 6/1\ng b\nf 1 2 5\nl 1 2 3\n".to_vec()),
            "c.txt" => Ok(b"0 0 0 0.1\n3 0 0 0.4\n\n0 1 0 0.2\n1 1 0 0.2\n2 1 0 0.2\n3 1 0 0.2\n4 1 0 0.2\n".to_vec()),
            "l.spd" => Ok(b"# nm, value\n400 1\n500 2 # here\n\n700 4\n".to_vec()),
            "t.vol" => Ok(vol(1, &[1.0, 3.0])),
            "a.vol" => Ok(vol(3, &[0.2, 0.5, 1.0, 0.4, 0.5, 0.0])),
            _ => Err("there is no such file".to_owned()),
        }
    }

    /// A file of two cells along x, from (1, 2, 3) to (3, 3, 4).
    fn vol(channels: i32, numbers: &[f32]) -> Vec<u8> {
        let mut file = b"VOL\x03".to_vec();
        [1, 2, 1, 1, channels].iter().for_each(|v: &i32| file.extend(v.to_le_bytes()));
        [1.0f32, 2.0, 3.0, 3.0, 3.0, 4.0].iter().chain(numbers).for_each(|v| file.extend(v.to_le_bytes()));
        file
    }

    fn read(body: &str) -> Result<Description, SceneError> {
        load(format!("<scene version='3.0.0'>\n{body}\n</scene>").as_bytes(), "s.xml", &fetch)
    }

    #[test]
    fn meshes_without_normals_are_smoothed_and_groups_keep_what_they_have() {
        let mesh = |more: &str| {
            let d = read(&format!("<shape type='obj'><string name='filename' value='roof.obj'/>{more}</shape>")).unwrap();
            d.meshes[0].clone()
        };
        let roof = mesh("");
        assert_eq!(
            (roof.triangles.len(), roof.normals.len(), roof.uvs[0].len()),
            (5, roof.positions.len(), roof.positions.len())
        );
        // Along the ridge between both faces, below on one.
        let at = |place: Vec3| {
            let k = roof.positions.iter().position(|p| *p == place).unwrap();
            (roof.normals[k], roof.uvs[0][k])
        };
        let (ridge, eaves) = (at(Vec3::new(1.0, 1.0, 1.0)), at(Vec3::ZERO));
        assert!((ridge.0 - Vec3::Z).length() < 1e-6 && (eaves.0 - Vec3::new(0.0, -1.0, 1.0).normalize()).length() < 1e-6);
        // Turned, as the files of this format are.
        assert_eq!(ridge.1, Vec2::new(1.0, 0.0));
        assert!(mesh("<boolean name='face_normals' value='true'/>").normals.is_empty());
    }

    #[test]
    fn elements_have_second_names() {
        let d = read(
            "<bsdf type='diffuse' id='a'><rgb name='reflectance' value='1, 0, 0'/></bsdf><alias id='a' as='b'/><shape type='sphere'><ref id='b'/></shape>",
        );
        assert!(matches!(d.unwrap().materials[0].scattering, Scattering::Diffuse(_)));
    }

    #[test]
    fn brushed_spheres_have_their_own_coordinates() {
        let is_sphere = |alpha: &str| {
            let bsdf = format!("<bsdf type='roughconductor'><string name='distribution' value='ggx'/>{alpha}</bsdf>");
            matches!(read(&format!("<shape type='sphere'>{bsdf}</shape>")).unwrap().objects[0].shape, Shape::Sphere(_))
        };
        assert!(is_sphere("<float name='alpha' value='0.1'/>"));
        assert!(!is_sphere("<float name='alpha_u' value='0.1'/><float name='alpha_v' value='0.4'/>"));
    }

    #[test]
    fn a_sensor_without_an_angle_has_a_lens_of_50_mm() {
        for (width, height) in [(768.0f64, 576.0), (48.0, 48.0), (300.0, 900.0)] {
            let film = format!(
                "<film type='hdrfilm'><integer name='width' value='{width}'/><integer name='height' value='{height}'/></film>"
            );
            let d = read(&format!("<sensor type='perspective'>{film}</sensor><shape type='cube'/>")).unwrap();
            let CameraProjection::Perspective { vertical_fov } = d.cameras[0].sight else { panic!("an angle") };
            let expected = 2.0 * (0.5 * 43.266_615 / 50.0 * height / width.hypot(height)).atan();
            assert!((f64::from(vertical_fov) - expected).abs() < 1e-6, "{width} x {height}: {vertical_fov}");
        }
    }

    #[test]
    fn coordinates_of_a_disk_are_its_radius_and_its_angle() {
        let d = read("<shape type='disk'/>").unwrap();
        let mesh = &d.meshes[0];
        for (p, uv) in mesh.positions.iter().zip(&mesh.uvs[0]) {
            let angle = std::f32::consts::TAU * uv.y;
            assert!((Vec3::new(angle.cos(), angle.sin(), 0.0) * uv.x - *p).length() < 1e-4, "{p} {uv}");
        }
    }

    #[test]
    fn shapes_stand_where_their_transforms_say() {
        let d = read(
            "<shape type='sphere'><point name='center' x='1' y='0' z='0'/><float name='radius' value='0.5'/>\
             <transform name='to_world'><scale value='2'/><rotate y='1' angle='90'/><translate value='0, 1, 0'/></transform></shape>\
             <shape type='rectangle'><transform name='to_world'><matrix value='1 0 0 5  0 1 0 6  0 0 1 7  0 0 0 1'/></transform></shape>\
             <shape type='obj'><string name='filename' value='t.obj'/></shape>\
             <shape type='cylinder'><point name='p0' value='1 2 3'/><point name='p1' value='1 2 7'/><float name='radius' value='2'/></shape>\
             <shape type='shapegroup' id='g'><shape type='cube'/></shape>\
             <shape type='instance'><ref id='g'/><transform name='to_world'><translate x='9'/></transform></shape>\
             <shape type='instance'><ref id='g'/></shape>",
        )
        .unwrap();
        let Shape::Sphere(s) = d.objects[0].shape else { panic!("a sphere") };
        // (1, 0, 0) scaled to (2, 0, 0), turned to (0, 0, −2), moved.
        assert!((s.center - Vec3::new(0.0, 1.0, -2.0)).length() < 1e-5 && (s.radius - 1.0).abs() < 1e-5);
        let place = |i: usize| match d.objects[i].shape {
            Shape::Mesh { mesh, world_from_mesh } => (mesh, world_from_mesh),
            _ => panic!("a mesh"),
        };
        assert!((place(1).1.transform_point3(Vec3::ZERO) - Vec3::new(5.0, 6.0, 7.0)).length() < 1e-5);
        // Mitsuba turns the coordinates of OBJ files: v runs down.
        assert!((d.meshes[place(2).0 as usize].uvs[0][2] - Vec2::new(0.0, 0.25)).length() < 1e-6);
        let (mesh, at) = place(3);
        let far = d.meshes[mesh as usize].positions.iter().map(|p| at.transform_point3(*p));
        let ends: Vec<f32> = far
            .map(|p| {
                assert!((p.truncate().distance(Vec2::new(1.0, 2.0)) - 2.0).abs() < 1e-4);
                p.z
            })
            .collect();
        assert!(ends.iter().all(|z| (z - 3.0).abs() < 1e-4 || (z - 7.0).abs() < 1e-4));
        assert_eq!((d.objects.len(), place(4).0), (6, place(5).0));
        crate::Scene::build(d).unwrap();
    }

    #[test]
    fn surfaces_lights_and_cameras_are_read() {
        let d = read(
            "<default name='fov' value='60'/>\
             <sensor type='thinlens'><float name='fov' value='$fov'/><string name='fov_axis' value='y'/><float name='aperture_radius' value='0.1'/>\
             <float name='focus_distance' value='4'/><transform name='to_world'><lookat origin='0,0,5' target='0,0,0' up='0,1,0'/></transform>\
             <film type='hdrfilm'><integer name='width' value='320'/><integer name='height' value='200'/></film></sensor>\
             <bsdf type='twosided' id='red'><bsdf type='diffuse'><rgb name='reflectance' value='.8, .1, .1'/></bsdf></bsdf>\
             <bsdf type='mask' id='m'><float name='opacity' value='0.25'/><ref id='red'/></bsdf>\
             <bsdf type='blendbsdf' id='b'><float name='weight' value='0.3'/><ref id='red'/><bsdf type='roughconductor'><string name='material' value='Au'/></bsdf></bsdf>\
             <shape type='sphere'><ref id='red'/></shape><shape type='sphere'><ref id='m'/></shape><shape type='sphere'><ref id='b'/></shape>\
             <shape type='sphere'><bsdf type='dielectric'><string name='int_ior' value='water'/><float name='ext_ior' value='1'/></bsdf>\
             <medium type='homogeneous' name='interior'><float name='sigma_t' value='2'/></medium></shape>\
             <emitter type='area' id='glow'><rgb name='radiance' value='7'/></emitter><shape type='rectangle'><ref id='glow'/></shape>\
             <emitter type='point'><point name='position' value='1,2,3'/><rgb name='intensity' value='3'/></emitter>\
             <emitter type='constant'><rgb name='radiance' value='0.5'/></emitter><emitter type='sunsky'/>",
        )
        .unwrap();
        let of = |i: usize| &d.materials[d.objects[i].material as usize];
        assert!(matches!(of(0).scattering, Scattering::Diffuse(_)) && matches!(of(1).coverage, Coverage::Blend(_)));
        assert!(matches!(&of(2).scattering, Scattering::Mix(_)));
        let Scattering::Principled(p) = &of(3).scattering else { panic!("glass") };
        assert!((p.ior - 1.333).abs() < 1e-6 && matches!(&of(3).interior, Interior::Body { medium: Some(_), .. }));
        let nits = of(4).emission.as_ref().unwrap().luminance(&[Vec2::ZERO; 2]);
        assert!((nits / 7.0 - 1.0).abs() < 0.01, "{nits}");
        assert!(matches!(d.punctual[0].kind, PunctualKind::Point { position } if position == Vec3::new(1.0, 2.0, 3.0)));
        assert!((d.environment.as_ref().unwrap().mean_luminance() - 0.5).abs() < 1e-3);
        let view = &d.cameras[0];
        assert!(
            matches!(view.sight, CameraProjection::Perspective { vertical_fov } if (vertical_fov - 60f32.to_radians()).abs() < 1e-5)
        );
        assert_eq!((view.lens, view.film.size), (Some([0.1, 4.0]), Some([320, 200])));
        let ahead = view.world_from_camera.transform_vector3(Vec3::NEG_Z);
        let right = view.world_from_camera.transform_vector3(Vec3::X);
        assert!((ahead - Vec3::NEG_Z).length() < 1e-5 && (right - Vec3::X).length() < 1e-5, "{ahead} {right}");
        let all = d.warnings.join("; ");
        assert!(all.contains("sunsky") && all.contains("Beckmann"), "{all}");
    }

    #[test]
    fn gloss_of_the_old_version_keeps_its_reflectance_and_width() {
        let d = read(
            "<bsdf type='phong' id='p'><float name='exponent' value='256'/><spectrum name='specularReflectance' value='0.1'/><rgb name='diffuseReflectance' value='.2, .3, .4'/></bsdf>\
             <bsdf type='ward' id='w'><float name='alphaU' value='0.2'/><float name='alphaV' value='0.3'/><rgb name='specularReflectance' value='.3, .6, .15'/></bsdf>\
             <bsdf type='roughdiffuse' id='r'><float name='alpha' value='0.3'/><rgb name='reflectance' value='.1, .2, .3'/></bsdf>\
             <shape type='sphere'><ref id='p'/></shape><shape type='sphere'><ref id='w'/></shape><shape type='sphere'><ref id='r'/></shape>",
        )
        .unwrap();
        let of = |i: usize| &d.materials[d.objects[i].material as usize].scattering;
        let gloss = |i: usize| match of(i) {
            Scattering::Principled(p) => p,
            _ => panic!("a coat"),
        };
        // At normal incidence: ((n − 1) / (n + 1))² times the scale and tint.
        let reflectance = |i: usize| {
            let (Scalar::Constant(scale), Some(tint)) = (&gloss(i).specular, gloss(i).specular_color.constant_rgb()) else {
                panic!("constants")
            };
            tint * (scale * ((gloss(i).ior - 1.0) / (gloss(i).ior + 1.0)).powi(2))
        };
        assert!((reflectance(0) - Vec3::splat(0.1)).length() < 1e-4, "{}", reflectance(0));
        assert!((reflectance(1) - Vec3::new(0.3, 0.6, 0.15)).length() < 1e-3, "{}", reflectance(1));
        // Coat and base together: what the two lobes add up to, seen from the front and from aside.
        let both = reflectance(0) + gloss(0).base_color.constant_rgb().unwrap() * (1.0 - 0.1);
        assert!((both - Vec3::new(0.3, 0.4, 0.5)).length() < 1e-3, "{both}");
        // α = (2 · 256 + 1)^(−1/2), its root.
        let Scalar::Constant(roughness) = gloss(0).roughness else { panic!("a constant") };
        assert!((roughness.powi(4) - 1.0 / 513.0).abs() < 1e-6);
        let Scalar::Constant(along) = gloss(1).roughness else { panic!("a constant") };
        assert!((along * along - 0.2).abs() < 1e-6 && gloss(1).anisotropy.is_some());
        assert!(matches!(of(2), Scattering::Diffuse(_)));
        let all = d.warnings.join("; ");
        assert!(["phong", "ward", "roughdiffuse"].iter().all(|name| all.contains(name)) && !all.contains("of bsdf"), "{all}");
    }

    #[test]
    fn files_of_the_old_version_are_read_by_its_names() {
        let old = "<sensor type='thinlens'><float name='fov' value='50'/><string name='fovAxis' value='y'/><float name='apertureRadius' value='0.1'/>\
            <float name='focusDistance' value='4'/><transform name='toWorld'><lookAt origin='0,0,5' target='0,0,0' up='0,1,0'/></transform></sensor>\
            <bsdf type='dielectric' id='g'><string name='intIOR' value='water'/><float name='extIOR' value='1'/></bsdf>\
            <bsdf type='diffuse' id='d'><texture name='diffuseReflectance' type='checkerboard'><float name='uscale' value='4'/><float name='uoffset' value='0.5'/></texture></bsdf>\
            <shape type='sphere'><transform name='toWorld'><translate x='3'/></transform><ref id='g'/>\
            <medium type='homogeneous' name='interior'><float name='sigmaT' value='2'/><float name='albedo' value='0.25'/></medium></shape>\
            <shape type='rectangle'><boolean name='flipNormals' value='true'/><ref id='d'/></shape>\
            <emitter type='spot'><float name='cutoffAngle' value='30'/><float name='beamWidth' value='10'/></emitter>";
        let new = [
            ("fovAxis", "fov_axis"),
            ("apertureRadius", "aperture_radius"),
            ("focusDistance", "focus_distance"),
            ("toWorld", "to_world"),
            ("lookAt", "lookat"),
            ("intIOR", "int_ior"),
            ("extIOR", "ext_ior"),
            (
                "<float name='sigmaT' value='2'/><float name='albedo' value='0.25'/>",
                "<float name='sigma_t' value='2'/><float name='albedo' value='0.25'/>",
            ),
            (
                "<float name='uscale' value='4'/><float name='uoffset' value='0.5'/>",
                "<transform name='to_uv'><scale x='4'/><translate x='0.5'/></transform>",
            ),
            ("diffuseReflectance", "reflectance"),
            ("flipNormals", "flip_normals"),
            ("cutoffAngle", "cutoff_angle"),
            ("beamWidth", "beam_width"),
        ];
        let renamed = new.iter().fold(old.to_owned(), |text, (from, to)| text.replace(from, to));
        let (a, b) = (read(old).unwrap(), read(&renamed).unwrap());
        assert_eq!(format!("{a:?}"), format!("{b:?}"));
        assert!(a.warnings.is_empty(), "{:?}", a.warnings);
        // It does say something: the camera stands where the file puts it.
        assert_eq!(a.cameras[0].world_from_camera.translation, glam::Vec3A::new(0.0, 0.0, 5.0));
        // Scattering and absorption by themselves are extinction and albedo.
        let apart =
            old.replace("'sigmaT' value='2'", "'sigmaA' value='1.5'").replace("'albedo' value='0.25'", "'sigmaS' value='0.5'");
        assert_eq!(format!("{:?}", read(&apart).unwrap()), format!("{a:?}"));
    }

    #[test]
    fn values_that_cannot_be_are_told() {
        for (bsdf, told) in [
            ("<bsdf type='diffuse'><rgb name='reflectance' value='3,0.2,0.2'/></bsdf>", "\"reflectance\" has below 0 or above 1"),
            ("<bsdf type='roughconductor'><float name='alpha' value='-3'/></bsdf>", "\"alpha\" has below 0"),
            (
                "<bsdf type='mask'><float name='opacity' value='7'/><bsdf type='diffuse'/></bsdf>",
                "\"opacity\" has below 0 or above 1",
            ),
        ] {
            let d = read(&format!("<shape type='sphere'>{bsdf}</shape>")).unwrap();
            assert!(d.warnings.iter().any(|w| w.contains(told)), "{bsdf}: {:?}", d.warnings);
        }
    }

    #[test]
    fn scales_of_specular_light_are_read() {
        let scattering = |bsdf: &str| {
            let d = read(&format!("<shape type='sphere'>{bsdf}</shape>")).unwrap();
            assert!(d.warnings.is_empty(), "{:?}", d.warnings);
            (d.materials[0].scattering.clone(), matches!(d.materials[0].interior, Interior::Body { .. }))
        };
        let rgb = |color: &crate::texture::Color| color.constant_rgb().unwrap();
        let scaled = |bsdf: &str| {
            let Scattering::Principled(p) = scattering(bsdf).0 else { panic!("{bsdf}") };
            p
        };
        // A dielectric that nothing goes through is its reflection over black, and no body.
        let marble = "<bsdf type='dielectric'><rgb name='specular_transmittance' value='0, 0, 0'/></bsdf>";
        let (p, is_body) = (scaled(marble), scattering(marble).1);
        assert!(!is_body && rgb(&p.base_color) == Vec3::ZERO && matches!(p.transmission, crate::texture::Scalar::Constant(0.0)));
        let tinted = "<bsdf type='dielectric'><rgb name='specular_transmittance' value='1, 0.5, 0.2'/></bsdf>";
        assert!(scattering(tinted).1 && rgb(&scaled(tinted).base_color) == Vec3::new(1.0, 0.5, 0.2));
        // What a scale of 1 leaves as it is stays exact.
        let white = "<bsdf type='roughconductor'><string name='distribution' value='ggx'/><rgb name='specular_reflectance' value='1, 1, 1'/></bsdf>";
        let Scattering::Conductor(copper) = scattering(white).0 else { panic!("a metal") };
        let metal = |bsdf: &str| {
            let Scattering::Conductor(metal) = scattering(bsdf).0 else { panic!("{bsdf}") };
            metal
        };
        let half = metal(&white.replace("1, 1, 1", "0.5, 0.5, 0.5"));
        assert!(half.normal_reflectance().abs_diff_eq(0.5 * copper.normal_reflectance(), 1e-6));
        let checkered = "<bsdf type='conductor'><texture name='specular_reflectance' type='checkerboard'/></bsdf>";
        assert!(matches!(metal(checkered).tint.as_deref(), Some(crate::texture::Color::Graph(_))));
        let plastic = scaled("<bsdf type='plastic'><rgb name='specular_reflectance' value='0.4, 0.2, 0.4'/></bsdf>");
        assert!(plastic.tinted && matches!(plastic.specular, crate::texture::Scalar::Constant(0.4)));
        assert_eq!(rgb(&plastic.specular_color), Vec3::new(1.0, 0.5, 1.0));
        let clear =
            read("<shape type='sphere'><bsdf type='dielectric'><float name='specular_reflectance' value='0.5'/></bsdf></shape>");
        assert!(clear.unwrap().warnings.join(";").contains("\"specular_reflectance\" of dielectric"));
    }

    /// Material of a sphere with a BSDF.
    fn on_a_sphere(bsdf: &str) -> crate::material::Material {
        let d = read(&format!("<shape type='sphere'>{bsdf}</shape>")).unwrap();
        d.materials[d.objects[0].material as usize].clone()
    }

    #[test]
    fn opacities_of_masks_and_parts_are_put_together() {
        let (a, b) = ("<bsdf type='diffuse'/>", "<bsdf type='conductor'/>");
        let mask =
            |opacity: &str, inner: &str| format!("<bsdf type='mask'><float name='opacity' value='{opacity}'/>{inner}</bsdf>");
        let blend = |weight: &str, a: &str, b: &str| {
            format!("<bsdf type='blendbsdf'><float name='weight' value='{weight}'/>{a}{b}</bsdf>")
        };
        let null = "<bsdf type='null'/>";
        let opacity = |bsdf: &str| match on_a_sphere(bsdf).coverage {
            Coverage::Full => 1.0,
            Coverage::Blend(Scalar::Constant(o)) => o,
            _ => panic!("{bsdf}: no constant"),
        };
        let close = |x: f32, y: f32| assert!((x - y).abs() < 1e-6, "{x}, not {y}");
        close(opacity(&mask("0.5", &mask("0.4", a))), 0.2);
        close(opacity(&blend("0.3", a, null)), 0.7);
        close(opacity(&blend("0.3", null, a)), 0.3);
        close(opacity(&blend("0.3", null, &mask("0.5", a))), 0.15);
        assert!(matches!(on_a_sphere(&blend("0.3", null, a)).scattering, Scattering::Diffuse(_)));
        assert!(matches!(on_a_sphere(&blend("0.3", null, null)).scattering, Scattering::Interface));
        // 0.7 of the one in full and 0.3 of the other at 0.5.
        let both = on_a_sphere(&blend("0.3", a, &mask("0.5", b)));
        let Scattering::Mix(mix) = both.scattering else { panic!("a mixture") };
        assert!(matches!(mix.1, Scalar::Constant(w) if (w - 0.15 / 0.85).abs() < 1e-6));
        close(opacity(&blend("0.3", a, &mask("0.5", b))), 0.85);
    }

    #[test]
    fn spectra_are_read_by_their_plugins() {
        let light = |spectrum: &str| {
            let d = read(&format!("<shape type='sphere'><emitter type='area'>{spectrum}</emitter></shape>")).unwrap();
            // Lamps reflect nothing unless they are told to.
            assert!(matches!(d.materials[0].scattering, Scattering::Black));
            let crate::material::EmissionColor::Constant(light) = d.materials[0].emission.clone().unwrap().radiance else {
                panic!("a constant")
            };
            light
        };
        let ratio = |l: &diopter_light::Spectrum| l.at(650.0) / l.at(450.0);
        let even = light("<spectrum name='radiance' value='5'/>");
        assert!((ratio(&even) - 1.0).abs() < 1e-6 && (diopter_light::color::luminance(|nm| even.at(nm)) - 5.0).abs() < 0.01);
        assert!(
            (ratio(&light("<spectrum name='radiance' type='uniform'><float name='value' value='5'/></spectrum>")) - 1.0).abs()
                < 1e-6
        );
        // 80.0 at 650 nm, 117.0 at 450 nm (CIE 15).
        assert!((ratio(&light("<spectrum name='radiance' type='d65'/>")) - 80.0 / 117.0).abs() < 0.03);
        let listed = light("<spectrum name='radiance' value='400:1, 500:2, 700:4'/>");
        let irregular = "<spectrum name='radiance' type='irregular'><string name='wavelengths' value='400, 500, 700'/><string name='values' value='1, 2, 4'/></spectrum>";
        let regular = "<spectrum name='radiance' type='regular'><float name='wavelength_min' value='400'/><float name='wavelength_max' value='700'/>\
            <string name='values' value='1, 2, 3, 4'/></spectrum>";
        for text in [irregular, regular, "<spectrum name='radiance' filename='l.spd'/>"] {
            let l = light(text);
            assert!([450.0, 560.0, 680.0].iter().all(|nm| (l.at(*nm) / listed.at(*nm) - 1.0).abs() < 1e-5), "{text}");
        }
        let warm = light("<spectrum name='radiance' type='blackbody'><float name='temperature' value='3000'/></spectrum>");
        assert!(ratio(&warm) > 3.0, "{}", ratio(&warm));
        // By its own radiance: Mitsuba 3.9.1 (scalar_spectral) gives a luminance of 414.5 where an even spectrum of 1 has 1.
        let brightness = diopter_light::color::luminance(|nm| warm.at(nm));
        assert!((brightness / 414.5 - 1.0).abs() < 0.01, "{brightness}");
        let wrong = |spectrum: &str| {
            read(&format!("<shape type='sphere'><emitter type='area'>{spectrum}</emitter></shape>")).unwrap_err().to_string()
        };
        assert!(wrong("<spectrum name='radiance' type='sparkle'/>").contains("spectrum \"sparkle\""));
        assert!(
            wrong("<spectrum name='radiance' type='irregular'><string name='wavelengths' value='1'/></spectrum>")
                .contains("without values")
        );
        assert!(wrong("<spectrum name='radiance' filename='c.txt'/>").contains("c.txt"));
    }

    #[test]
    fn crops_and_principal_points_shift_the_picture() {
        let camera = |sensor: &str, film: &str| {
            let numbers = "<float name='fov' value='90'/><string name='fov_axis' value='y'/>";
            let film = format!(
                "<film type='hdrfilm'><integer name='width' value='40'/><integer name='height' value='20'/>{film}</film>"
            );
            read(&format!("<shape type='sphere'/><sensor type='perspective'>{numbers}{sensor}{film}</sensor>")).map(|d| {
                (d.cameras[0].film.size.unwrap(), d.cameras[0].vertical_fov().unwrap(), d.cameras[0].film.shift, d.warnings.len())
            })
        };
        let crop = |x: u32, y: u32, w: u32, h: u32| {
            [("crop_offset_x", x), ("crop_offset_y", y), ("crop_width", w), ("crop_height", h)]
                .map(|(name, n)| format!("<integer name='{name}' value='{n}'/>"))
                .concat()
        };
        let right_angle = std::f32::consts::FRAC_PI_2;
        assert_eq!(camera("", "").unwrap(), ([40, 20], right_angle, [0.0, -0.0], 0));
        // The last five columns and the second half of the rows: 17.5 pixels to the right of the middle, 5 below it.
        let (size, fov, shift, warnings) = camera("", &crop(35, 10, 5, 10)).unwrap();
        assert!(size == [5, 10] && warnings == 0 && (fov - 2.0 * 0.5f32.atan()).abs() < 1e-6, "{size:?} {fov}");
        assert_eq!(shift, [1.75, -0.5]);
        // Mitsuba 3.9.1 shows at a principal point offset of (0.25, 0.1) what lay a quarter of the width to the right and a tenth of the height below.
        let offsets = "<float name='principal_point_offset_x' value='0.25'/><float name='principal_point_offset_y' value='0.1'/>";
        let (_, fov, shift, warnings) = camera(offsets, "").unwrap();
        assert!(fov == right_angle && warnings == 0 && shift[0] == 0.5 && (shift[1] + 0.1).abs() < 1e-9, "{shift:?}");
        assert!(camera("", &crop(36, 10, 5, 10)).unwrap_err().to_string().contains("5 x 10 pixels from 36, 10 on"));
    }

    #[test]
    fn what_differs_from_the_file_is_said() {
        let said = |body: &str| read(body).unwrap().warnings.join("; ");
        let ball = "<shape type='sphere'/>";
        let sensor = |inner: &str| format!("{ball}<sensor type='perspective'><float name='fov' value='40'/>{inner}</sensor>");
        assert!(said(&sensor("<medium type='homogeneous'/>")).contains("medium around a sensor"));
        assert!(said(&sensor("<transform name='to_world'><scale x='-1'/></transform>")).contains("mirroring of a sensor"));
        let two = "<shape type='sphere'><bsdf type='twosided'><bsdf type='diffuse'/><bsdf type='conductor'/></bsdf></shape>";
        assert!(said(two).contains("back of twosided"));
        assert_eq!(said(&sensor("<film type='hdrfilm'><integer name='width' value='10'/></film>")), "");
    }

    #[test]
    fn srgb_is_in_codes_and_rgb_is_not() {
        let color = |tag: &str, value: &str| {
            let d = read(&format!(
                "<shape type='sphere'><bsdf type='diffuse'><{tag} name='reflectance' value='{value}'/></bsdf></shape>"
            ));
            let Scattering::Diffuse(color) = d.unwrap().materials[0].scattering.clone() else { panic!("diffuse") };
            color.constant_rgb().unwrap()
        };
        let half = diopter_light::color::srgb_decode(0.5);
        assert_eq!(color("rgb", "0.5, 0.5, 0.5"), Vec3::splat(0.5));
        assert_eq!(color("srgb", "0.5, 0.5, 0.5"), Vec3::splat(half));
        assert_eq!(color("srgb", "#ff0000"), Vec3::new(1.0, 0.0, 0.0));
    }

    #[test]
    fn spots_fade_linearly_in_the_angle() {
        let spot = "<shape type='sphere'/><emitter type='spot'><float name='cutoff_angle' value='20'/><float name='beam_width' value='10'/></emitter>";
        let lamp = &read(spot).unwrap().punctual[0];
        let nm = diopter_light::SampledWavelengths::rgb();
        for (degrees, expected) in [(0.0, 1.0), (9.9, 1.0), (12.5, 0.75), (15.0, 0.5), (17.5, 0.25), (20.1, 0.0), (180.0, 0.0)] {
            let (sin, cos) = f32::sin_cos(f32::to_radians(degrees));
            let found = lamp.relative_intensity(None, Vec3::new(sin, 0.0, cos), &nm).x;
            assert!((found - expected).abs() < 1e-3, "{degrees}: {found}");
        }
    }

    #[test]
    fn values_that_nothing_reads_are_named() {
        let shape = "<bsdf type='diffuse' id='never used'><float name='x' value='1'/></bsdf><shape type='sphere'><float name='radius' value='2'/>\
            <float name='raduis' value='3'/><bsdf type='diffuse'><rgb name='reflectence' value='1, 0, 0'/></bsdf></shape>\
            <emitter type='sunsky'><float name='turbidity' value='3'/></emitter><sensor type='perspective'><float name='near_clip' value='1'/></sensor>";
        // What is left out as a whole is not told by its parts; what changes no picture is not told.
        let shape = &format!(
            "{shape}<sensor type='radiancemeter'><sampler type='independent'><integer name='sample_count' value='4'/></sampler></sensor>\
             <shape type='sphere'><bsdf type='bumpmap'><texture type='bitmap'><string name='filename' value='b.png'/><boolean name='raw' value='true'/></texture>\
             <bsdf type='roughconductor'><boolean name='sample_visible' value='true'/></bsdf></bsdf></shape>\
             <shape type='sphere'><bsdf type='diffuse'><texture type='bitmap' name='reflectance'><string name='filename' value='gone.png'/>\
             <string name='wrap_mode' value='clamp'/></texture></bsdf></shape>"
        );
        let warnings = read(shape).unwrap().warnings.join("; ");
        for quiet in ["sample_count", "filename", "raw\"", "sample_visible", "wrap_mode"] {
            assert!(!warnings.contains(quiet), "{quiet}: {warnings}");
        }
        assert!(
            warnings.contains("\"raduis\" of shape \"sphere\"") && warnings.contains("\"reflectence\" of bsdf \"diffuse\""),
            "{warnings}"
        );
        assert!(["\"radius\"", "\"x\"", "turbidity", "near_clip"].iter().all(|w| !warnings.contains(w)), "{warnings}");
    }

    #[test]
    fn curves_and_hair_are_read() {
        let text = |kind: &str| {
            format!(
                "<bsdf type='hair' id='h'><float name='pheomelanin' value='0.7'/><float name='azimuthal_roughness' value='0.2'/></bsdf>\
                 <shape type='{kind}'><string name='filename' value='c.txt'/><ref id='h'/>\
                 <transform name='to_world'><scale value='2'/><translate z='5'/></transform></shape>"
            )
        };
        let of = |d: &Description| {
            let Shape::Curves { curves, .. } = d.objects[0].shape else { panic!("curves") };
            (*d.curves[curves as usize]).clone()
        };
        let d = read(&text("linearcurve")).unwrap();
        // A pair of points is a straight cubic; radii stay what they are.
        let set = of(&d);
        assert_eq!((set.segments.len(), set.points.len()), (5, 4 + 13));
        assert!((set.points[2] - glam::Vec4::new(4.0, 0.0, 5.0, 0.3)).length() < 1e-6, "{}", set.points[2]);
        let Scattering::Hair(hair) = &d.materials[d.objects[0].material as usize].scattering else { panic!("hair") };
        let number = |s: &crate::texture::Scalar| if let crate::texture::Scalar::Constant(v) = s { *v } else { f32::NAN };
        assert_eq!([&hair.beta_m, &hair.beta_n, &hair.alpha].map(number), [0.3, 0.2, 2.0]);
        assert!((hair.eta - 1.55 / 1.000277).abs() < 1e-5);
        let crate::material::Pigment::Melanin { eumelanin, pheomelanin, .. } = &hair.pigment else { panic!("melanin") };
        assert_eq!([eumelanin, pheomelanin].map(number), [1.3, 0.7]);
        crate::Scene::build(d).unwrap();
        // Splines need four points: the first curve has only two.
        let set = of(&read(&text("bsplinecurve")).unwrap());
        assert_eq!((set.segments, set.points.len()), (vec![0, 1], 5));
    }

    #[test]
    fn grids_fill_media() {
        let text = |albedo: &str| {
            format!(
                "<medium type='heterogeneous' id='m'><float name='scale' value='10'/><volume type='gridvolume' name='sigma_t'>\
                 <string name='filename' value='t.vol'/><boolean name='use_grid_bbox' value='true'/></volume>{albedo}\
                 <phase type='hg'><float name='g' value='0.3'/></phase></medium>\
                 <shape type='cube'><bsdf type='null'/><ref name='interior' id='m'/></shape>"
            )
        };
        let medium = |albedo: &str| {
            let d = read(&text(albedo)).unwrap_or_else(|e| panic!("{e}"));
            let Interior::Sides([Some(inside), None]) = &d.materials[0].interior else { panic!("a medium") };
            inside.clone()
        };
        let nm = diopter_light::SampledWavelengths::rgb();
        let even = medium("<float name='albedo' value='0.8'/>");
        let volume = even.volume.as_ref().unwrap();
        assert!(format!("{volume:?}").contains("Density") && even.asymmetry == 0.3);
        assert!((even.absorption.sample(&nm).x - 2.0).abs() < 1e-5 && (even.scattering.sample(&nm).x - 8.0).abs() < 1e-5);
        // Middles of cells at a quarter and three quarters of the way from x = 1 to 3; beyond them it goes on.
        let density = |x: f32| volume.factors(Vec3::new(0.5 * (x - 1.0), 0.5, 0.5), &nm)[0].x;
        for (x, expected) in [(1.01, 1.0), (1.5, 1.0), (2.0, 2.0), (2.25, 2.5), (2.5, 3.0), (2.99, 3.0)] {
            assert!((density(x) - expected).abs() < 1e-4, "{x}: {}", density(x));
        }
        let colored = medium(
            "<volume type='gridvolume' name='albedo'><string name='filename' value='a.vol'/><boolean name='use_grid_bbox' value='true'/></volume>",
        );
        let [absorption, scattering] = colored.volume.as_ref().unwrap().factors(Vec3::new(0.75, 0.5, 0.5), &nm);
        for (found, expected) in [(absorption, [1.8, 1.5, 3.0]), (scattering, [1.2, 1.5, 0.0])] {
            let apart = (0..3).map(|i| (found.to_array()[i] - expected[i]).abs()).fold(0.0, f32::max);
            // Spectra are made of the colours and looked at again.
            assert!(apart < 0.03, "{found} {expected:?}");
        }
    }

    #[test]
    fn lists_of_values_end_at_their_ends_and_indices_go_on() {
        let list = "value='500:0.2, 600:0.6'";
        let d = read(&format!(
            "<shape type='sphere'><bsdf type='diffuse'><spectrum name='reflectance' {list}/></bsdf></shape>\
             <emitter type='constant'><spectrum name='radiance' {list}/></emitter>\
             <shape type='sphere'><bsdf type='conductor'><spectrum name='eta' {list}/></bsdf></shape>"
        ))
        .unwrap();
        let nm = diopter_light::SampledWavelengths::fixed([450.0, 500.0, 550.0, 650.0]);
        let table = values::bounded(&[(500.0, 0.2), (600.0, 0.6)]);
        let found = [450.0, 500.0, 550.0, 650.0].map(|nm| table.at(nm));
        assert!(found.iter().zip([0.0, 0.2, 0.4, 0.0]).all(|(a, b)| (a - b).abs() < 1e-5), "{found:?}");
        let light = d.environment.as_ref().unwrap().radiance(Vec3::X, &nm).to_array();
        assert!(light[0] == 0.0 && light[3] == 0.0 && (light[2] / light[1] - 2.0).abs() < 1e-5, "{light:?}");
        let Scattering::Conductor(metal) = &d.materials[1].scattering else { panic!("a metal") };
        assert_eq!((metal.n.at(450.0), metal.n.at(650.0)), (0.2, 0.6));
        // Theirs of the other number.
        assert_eq!(metal.k.at(550.0), 1.0);
    }

    #[test]
    fn metals_have_the_constants_of_their_names_against_what_is_around() {
        let metal = |more: &str| {
            let d = read(&format!("<shape type='sphere'><bsdf type='conductor'>{more}</bsdf></shape>"))?;
            let Scattering::Conductor(metal) = d.materials[0].scattering.clone() else { panic!("a metal") };
            Ok::<_, SceneError>([metal.n.at(550.0), metal.k.at(550.0)])
        };
        let named = metals::of("W").unwrap().map(|t| t.at(550.0));
        assert_eq!(metal("<string name='material' value='W'/>").unwrap(), named);
        let wet = metal("<string name='material' value='W'/><string name='ext_eta' value='water'/>").unwrap();
        assert!(wet.iter().zip(named).all(|(wet, dry)| (dry / wet - 1.333).abs() < 1e-3), "{wet:?} {named:?}");
        let e = metal("<string name='material' value='Xy'/>").unwrap_err().to_string();
        assert!(e.contains("Xy") && e.contains("Ni_palik"), "{e}");
        assert!(metal("<float name='ext_eta' value='0'/>").is_err());
    }

    #[test]
    fn a_thin_principled_sheet_reflects_as_far_as_it_lets_through() {
        let gloss = |kind: &str, more: &str| {
            let d = read(&format!("<shape type='sphere'><bsdf type='{kind}'>{more}</bsdf></shape>")).unwrap();
            let Scattering::Principled(p) = d.materials[0].scattering.clone() else { panic!("a gloss") };
            let Scalar::Constant(specular) = p.specular else { panic!("a constant") };
            // Without the mark the strength counts for nothing.
            if p.tinted { specular } else { 1.0 }
        };
        assert_eq!(gloss("principledthin", ""), 0.0);
        assert_eq!(gloss("principledthin", "<float name='spec_trans' value='0.3'/>"), 0.3);
        assert_eq!(gloss("principled", ""), 1.0);
    }

    #[test]
    fn values_by_reference_and_volumes_of_one_value_count() {
        let d = read(
            "<spectrum type='d65' id='s'><float name='scale' value='7'/></spectrum><emitter type='constant'><ref name='radiance' id='s'/></emitter>\
             <shape type='sphere'><bsdf type='null'/><medium type='homogeneous' name='interior'>\
             <volume type='constvolume' name='sigma_t'><float name='value' value='3'/></volume><float name='albedo' value='0'/></medium></shape>",
        )
        .unwrap();
        let nits = d.environment.as_ref().unwrap().mean_luminance();
        assert!((nits / 7.0 - 1.0).abs() < 1e-3, "{nits}");
        let Interior::Sides([Some(medium), None]) = &d.materials[0].interior else { panic!("a medium within") };
        let nm = diopter_light::SampledWavelengths::rgb();
        assert!((medium.absorption.sample(&nm).x - 3.0).abs() < 1e-5);
        assert!(d.warnings.is_empty(), "{:?}", d.warnings);
    }

    #[test]
    fn bad_scenes_are_told_where_and_what() {
        for (body, word) in [
            ("<shape type='sphere'><ref id='gone'/></shape>", "line 2: \"gone\""),
            ("<shape type='sphere'><bsdf type='polarizer'/></shape>", "bsdf \"polarizer\""),
            ("<shape type='teapot'/>", "shape \"teapot\""),
            ("<shape type='sphere'><float name='radius' value='x'/></shape>", "finite number"),
            ("<shape type='sphere'><transform name='to_world'><scale value='0'/></transform></shape>", "inverted"),
            ("<bsdf type='twosided' id='a'><ref id='a'/></bsdf><shape type='sphere'><ref id='a'/></shape>", "within BSDFs"),
            ("<shape type='obj'><string name='filename' value='gone.obj'/></shape>", "no such file"),
            (
                "<shape type='sphere'><medium type='heterogeneous' name='interior'><rgb name='sigma_t' value='x'/></medium></shape>",
                "\"x\"",
            ),
            (
                "<shape type='sphere'><medium type='heterogeneous' name='interior'><volume type='gridvolume' name='sigma_t'>\
                 <string name='filename' value='t.obj'/></volume></medium></shape>",
                "it does not begin with VOL",
            ),
            ("<shape type='linearcurve'><string name='filename' value='t.obj'/></shape>", "line 1"),
            ("<emitter type='constant'/>", "no surface"),
            ("<shpae type='cube'/>", "line 2: <shpae>; expected an element of Mitsuba's scenes (did you mean <shape>?)"),
            ("<shape type='sphere'><flaot name='radius' value='2'/></shape>", "did you mean <float>?"),
            ("<shape type='sphere'><string name='radius' value='2'/></shape>", "a string as \"radius\""),
            ("<shape type='sphere'><float name='radius'/></shape>", "\"radius\" without a value"),
            (
                "<bsdf type='diffuse' id='a'/><bsdf type='conductor' id='a'/><shape type='sphere'/>",
                "another element with the id \"a\"",
            ),
            ("<shape type='sphere'><bsdf type='diffuse'/><bsdf type='diffuse'/></shape>", "2 bsdfs in one shape"),
            ("<shape type='sphere'><emitter type='area'/><emitter type='area'/></shape>", "2 emitters in one shape"),
            (
                "<emitter type='constant'><texture type='checkerboard' name='radiance'/></emitter><shape type='cube'/>",
                "a texture as \"radiance\"",
            ),
            (
                "<sensor type='orthographic'><transform name='to_world'><scale x='2' y='3'/></transform></sensor><shape type='cube'/>",
                "scaled by 2.0000 across and 3.0000 upwards",
            ),
        ] {
            let e = read(body).unwrap_err().to_string();
            assert!(e.starts_with("s.xml") && e.contains(word), "{body}: {e}");
        }
    }

    #[test]
    fn damaged_scenes_never_panic() {
        let text = "<scene version='3.0.0'><default name='a' value='2'/><shape type='sphere'><float name='radius' value='$a'/>\
            <bsdf type='diffuse'><rgb name='reflectance' value='#80ff00'/></bsdf><transform name='to_world'><lookat origin='0,0,5' target='0,0,0' up='0,1,0'/>\
            </transform></shape></scene>";
        assert!(load(text.as_bytes(), "s.xml", &fetch).is_ok());
        for i in 0..text.len() {
            for change in *b"9'<-x" {
                let mut bytes = text.as_bytes().to_vec();
                bytes[i] = change;
                let _ = load(&bytes, "s.xml", &fetch).map(crate::Scene::build);
            }
        }
    }
}
