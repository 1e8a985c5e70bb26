//! What is written and read field by field, and what lies in tables.

use super::{Exact, Sink, Source, exact_enum, exact_struct, field};
use crate::light::punctual::{Pattern, Spread};
use crate::light::{Modulation, Punctual, PunctualKind, SpotEdge};
use crate::material::conductor::FacetBounces;
use crate::material::{
    Bump, BumpUnit, Conductor, Coverage, DEEPEST_MIX, Emission, EmissionColor, Hair, Interior, Material, Measured, Pigment,
    Scattering,
};
use crate::medium::{Air, Cloud, Coefficient, Field, Glow, Medium, Scalars};
use crate::motion::Parts;
use crate::scene::{CameraProjection, FilmHints, LensTable};
use crate::shape::{CurveBasis, CurveKind, Curves, Quad, Sphere};
use crate::texture::{Codes, Color, Graph, Image, Interpolation, Mapping, MeasuredColor, NoisePattern, Scalar, Texture, Wrap};
use diopter_image::Raster;
use diopter_light::Spectrum;
use diopter_light::spectrum::Table;
use diopter_light::upsample::Sigmoid;
use glam::{Vec3, Vec4};
use serde_json::Value;
use std::sync::Arc;

exact_struct!(Sigmoid { c, rgb });
exact_enum!(Spectrum { Constant(value), Sigmoid(sigmoid), RgbLight { scale, color }, Table(table), TableOfRgb { table, rgb } });
exact_struct!(Parts { translation, rotation, scale });

exact_enum!(Coefficient { Scaled(per_m, spectrum), Tint { color, distance_m } });
exact_struct!(Medium { name, absorption, scattering, asymmetry, emission, volume, is_subsurface });
exact_struct!(Air { medium, bounds });
exact_struct!(Cloud { density, wispiness, frequency });
exact_enum!(Scalars { Grid(grid), Sparse(grid) });
exact_enum!(Field { Density(scalars), Cloud(cloud), Colors { absorption, scattering } });
exact_enum!(Glow { Scaled(grid), Colors(grid, factor), BlackBody { temperature, offset, factor, peak_radiance } });

exact_enum!(Codes { Srgb, Linear });
exact_enum!(Wrap { Repeat, Mirror, Clamp, Black });
exact_enum!(Interpolation { Nearest, Bilinear });
exact_struct!(Texture { image, codes, wrap, interpolation, uv_set, image_from_uv });
exact_enum!(Mapping { Uv(factors), Spherical(place), Cylindrical(place), Planar(place, vectors, offset) });
exact_enum!(NoisePattern { Fbm(octaves, roughness), Wrinkled(octaves, roughness), Windy, Marble(octaves, roughness, variation) });
exact_enum!(Graph {
    Constant(value),
    Image { texture, scale, invert, as_number, mapping },
    Scale(a, b),
    Mix(a, b, amount),
    DirectionMix { along, across, direction },
    Power(base, exponent),
    Checkerboard { place, even, odd },
    Bilinear { place, corners },
    Dots { place, inside, outside },
    Cubes { texture_from_world, even, odd },
    Noise { texture_from_world, pattern },
});
exact_struct!(MeasuredColor { spectrum, rgb });
exact_enum!(Color { Constant { rgb, sigmoid }, Spectrum(measured), Textured { factor, texture }, Graph(graph) });

exact_struct!(Material { name, scattering, emission, normal_map, bump, coverage, interior });
exact_enum!(Interior { Same, Body { medium, priority }, Sides(sides) });
exact_enum!(FacetBounces { Compensated, Lost });
exact_struct!(Conductor { n, k, alpha, across, bounces } or { tint: None });
exact_struct!(Hair { pigment, eta, beta_m, beta_n, alpha });
exact_enum!(Pigment { Absorption(spectrum), AbsorptionMap(graph), Reflectance(color), Melanin { eumelanin, pheomelanin, spectra } });
exact_enum!(Coverage { Full, Mask { alpha, cutoff }, Blend(alpha) });
exact_struct!(Emission { radiance, two_sided, is_light, modulation });
exact_enum!(EmissionColor { Constant(spectrum), Textured { factor, texture }, Captured { factor } });
exact_struct!(Bump { height, unit });
exact_enum!(BumpUnit { Length(metres), Extent(fraction) });
exact_enum!(Modulation {
    Steady,
    Sine { frequency_hz, depth, phase },
    Pwm { frequency_hz, duty, phase },
    Pulse { start_s, length_s, energy },
});

exact_struct!(Punctual { name, power, kind, carrier, modulation, pattern });
exact_enum!(PunctualKind {
    Point { position },
    Spot { position, direction, cos_inner, cos_outer, edge },
    Directional { direction },
    Disc { direction, half_angle },
});
exact_enum!(SpotEdge { Squared, Smooth, LinearInAngle });
exact_struct!(Pattern { picture, light_from_world, spread });
exact_enum!(Spread { Sphere, Frame(tangents), Web(web) });

exact_struct!(Sphere { center, radius });
exact_struct!(Quad { corner, edges });
exact_enum!(CurveKind { Flat, Cylinder, Ribbon });
exact_enum!(CurveBasis { Bezier, BSpline });
exact_enum!(CameraProjection { Perspective { vertical_fov }, Orthographic { height }, Panorama, Table(table) });
exact_struct!(LensTable { file, bytes, stop_mm, focus_m });
exact_struct!(FilmHints { size, diagonal_mm, sensor, iso } or { shift: [0.0; 2] });

/// Most pictures that are looked up for one value of a graph.
const MOST_LOOKUPS: usize = 512;

impl Exact for Table {
    fn write(&self, sink: &mut Sink) -> Value {
        let object = [
            ("first_nm", self.first_nm().write(sink)),
            ("per_nm", self.per_nm().write(sink)),
            ("values", self.values().to_vec().write(sink)),
        ];
        object.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let (first_nm, per_nm, values) = (
            field::<f32>(value, "first_nm", source)?,
            field::<f32>(value, "per_nm", source)?,
            field::<Vec<f32>>(value, "values", source)?,
        );
        if values.is_empty() || !(per_nm > 0.0) {
            return Err(format!("{} values, {per_nm} a nanometre", values.len()));
        }
        Ok(Table::from_parts(first_nm, per_nm, values))
    }
}

impl Exact for Raster<f32> {
    fn write(&self, sink: &mut Sink) -> Value {
        let (size, data) = ([self.width, self.height, self.channels].write(sink), self.data.write(sink));
        [("size".to_owned(), size), ("data".to_owned(), data)].into_iter().collect()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let [width, height, channels] = field::<[usize; 3]>(value, "size", source)?;
        let data: Vec<f32> = field(value, "data", source)?;
        let count = width.checked_mul(height).and_then(|n| n.checked_mul(channels));
        if count != Some(data.len()) {
            return Err(format!("{} numbers for {width} × {height} × {channels}", data.len()));
        }
        Ok(Raster { width, height, channels, data })
    }
}

impl Exact for Arc<Image> {
    fn write(&self, sink: &mut Sink) -> Value {
        sink.store.picture(self).into()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let number = usize::read(value, source)?;
        source.images.get(number).cloned().flatten().ok_or_else(|| format!("no picture {number}"))
    }
}

impl Exact for Arc<Medium> {
    fn write(&self, sink: &mut Sink) -> Value {
        let key = Arc::as_ptr(self);
        if let Some(number) = sink.tables.known_media.get(&key) {
            return (*number).into();
        }
        let written = (**self).write(sink);
        sink.tables.media.push(written);
        let number = sink.tables.media.len() - 1;
        sink.tables.known_media.insert(key, number);
        number.into()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let number = usize::read(value, source)?;
        source.media.get(number).cloned().ok_or_else(|| format!("no medium {number}"))
    }
}

impl Exact for Arc<Graph> {
    fn write(&self, sink: &mut Sink) -> Value {
        let key = Arc::as_ptr(self);
        if let Some(number) = sink.tables.known_graphs.get(&key) {
            return (*number).into();
        }
        // What it is made of comes before it.
        let written = (**self).write(sink);
        sink.tables.graphs.push(written);
        let number = sink.tables.graphs.len() - 1;
        sink.tables.known_graphs.insert(key, number);
        number.into()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let number = usize::read(value, source)?;
        source.graphs.get(number).cloned().ok_or_else(|| format!("no graph {number}"))
    }
}

/// A graph that may be looked up.
pub(crate) fn checked(graph: Graph) -> Result<Graph, String> {
    // Each is counted from those it is made of, which are small enough already.
    let lookups = graph.lookups();
    if lookups > MOST_LOOKUPS { Err(format!("a graph of {lookups} pictures")) } else { Ok(graph) }
}

impl Exact for Arc<MeasuredColor> {
    fn write(&self, sink: &mut Sink) -> Value {
        (**self).write(sink)
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        MeasuredColor::read(value, source).map(Arc::new)
    }
}

impl Exact for Arc<Pattern> {
    fn write(&self, sink: &mut Sink) -> Value {
        (**self).write(sink)
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let pattern = Pattern::read(value, source)?;
        let has_picture = pattern.picture.channels == 3 && !pattern.picture.data.is_empty();
        if !matches!(pattern.spread, Spread::Web(_)) && !has_picture {
            return Err("a light that shines by a picture without one".into());
        }
        Ok(Arc::new(pattern))
    }
}

impl Exact for Arc<Measured> {
    fn write(&self, sink: &mut Sink) -> Value {
        let key = Arc::as_ptr(self);
        if let Some(known) = sink.tables.known_measured.get(&key) {
            return Value::from(*known);
        }
        let written = (**self).write(sink);
        let number = sink.tables.measured.len();
        sink.tables.measured.push(written);
        sink.tables.known_measured.insert(key, number);
        Value::from(number)
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let number = usize::read(value, source)?;
        source.measured.get(number).cloned().ok_or_else(|| format!("no measured material {number}"))
    }
}

impl Exact for Scalar {
    fn write(&self, sink: &mut Sink) -> Value {
        match self {
            Scalar::Constant(number) => number.write(sink),
            Scalar::Textured { factor, texture, channel } => {
                let object = [("factor", factor.write(sink)), ("texture", texture.write(sink)), ("channel", channel.write(sink))];
                object.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
            }
            Scalar::Graph(graph) => [("graph".to_owned(), graph.write(sink))].into_iter().collect(),
        }
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        if !value.is_object() {
            return f32::read(value, source).map(Scalar::Constant);
        }
        if value.get("graph").is_some() {
            return field(value, "graph", source).map(Scalar::Graph);
        }
        let channel: usize = field(value, "channel", source)?;
        if channel > 3 {
            return Err(format!("channel {channel}"));
        }
        Ok(Scalar::Textured { factor: field(value, "factor", source)?, texture: field(value, "texture", source)?, channel })
    }
}

/// Variants of [`Scattering`] whose parts are written as they are.
macro_rules! scattering {
    ($($variant:ident),+) => {
        impl Exact for Scattering {
            fn write(&self, sink: &mut Sink) -> Value {
                let (name, of) = match self {
                    Scattering::Black => ("Black", Value::Null),
                    Scattering::Interface => ("Interface", Value::Null),
                    $( Scattering::$variant(part) => (stringify!($variant), part.write(sink)), )+
                };
                [("is".to_owned(), name.into()), ("of".to_owned(), of)].into_iter().collect()
            }

            fn read(value: &Value, source: &Source) -> Result<Self, String> {
                let name = value.get("is").and_then(Value::as_str).unwrap_or_default();
                let read = match name {
                    "Black" => Scattering::Black,
                    "Interface" => Scattering::Interface,
                    $( _ if name == stringify!($variant) => Scattering::$variant(field(value, "of", source)?), )+
                    other => return Err(format!("scattering \"{other}\"")),
                };
                match read.parts() {
                    (_, depth) if depth > DEEPEST_MIX => Err(format!("mixtures {depth} deep")),
                    _ => Ok(read),
                }
            }
        }
    };
}
scattering!(Diffuse, Conductor, Coated, Principled, DiffuseTransmission, Hair, Measured, Mix);

impl Exact for Curves {
    fn write(&self, sink: &mut Sink) -> Value {
        let points: Vec<[f32; 4]> = self.points.iter().map(|p| p.to_array()).collect();
        let normals: Vec<[[f32; 3]; 2]> = self.normals.iter().map(|n| n.map(|v| v.to_array())).collect();
        let object = [
            ("kind", self.kind.write(sink)),
            ("basis", self.basis.write(sink)),
            ("points", points.write(sink)),
            ("segments", self.segments.write(sink)),
            ("normals", normals.write(sink)),
        ];
        object.into_iter().map(|(k, v)| (k.to_owned(), v)).collect()
    }

    fn read(value: &Value, source: &Source) -> Result<Self, String> {
        let points: Vec<[f32; 4]> = field(value, "points", source)?;
        let normals: Vec<[[f32; 3]; 2]> = field(value, "normals", source)?;
        let curves = Curves {
            kind: field(value, "kind", source)?,
            basis: field(value, "basis", source)?,
            points: points.into_iter().map(Vec4::from_array).collect(),
            segments: field(value, "segments", source)?,
            normals: normals.into_iter().map(|n| n.map(Vec3::from_array)).collect(),
        };
        let in_range =
            curves.segments.iter().all(|first| (*first as usize).checked_add(3).is_some_and(|last| last < curves.points.len()));
        let has_normals = match curves.kind {
            CurveKind::Ribbon => curves.normals.len() == curves.segments.len(),
            _ => curves.normals.is_empty(),
        };
        if in_range && has_normals { Ok(curves) } else { Err("curves whose lists do not fit each other".into()) }
    }
}
