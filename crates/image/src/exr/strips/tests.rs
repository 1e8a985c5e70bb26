use super::super::{read_layer, write_channels};
use super::*;
use crate::focal_plane::{BandUnit, STRIP_STEP, Strips};
use exr::prelude::Blocks as BlockLayout;
use std::io::Cursor;

const SIZE: [usize; 2] = [5, 53];

fn plane() -> FocalPlane {
    let [width, height] = SIZE;
    let raster = |channels: usize, phase: f32| {
        let mut raster = Raster::<f32>::new(width, height, channels);
        raster.data.iter_mut().enumerate().for_each(|(i, v)| *v = (i as f32 * 0.37 + phase).sin());
        raster
    };
    let mut truth = Truth::empty(5, 53);
    (*truth.depth_mut(), *truth.normal_mut(), *truth.albedo_mut()) = (raster(1, 3.0), raster(3, 4.0), raster(3, 5.0));
    truth.id_mut().data.iter_mut().enumerate().for_each(|(i, v)| *v = u32::MAX - i as u32);
    let band = |n: &str| Band { name: n.into(), unit: BandUnit::Electrons };
    FocalPlane {
        bands: ["R", "G", "B"].map(band).to_vec(),
        mean: raster(3, 1.0),
        half_difference: raster(3, 2.0),
        truth,
        facts: ExposureFacts { body: "a body – 写真".into(), software: "diopter".into(), ..Default::default() },
    }
}

fn file(plane: &FocalPlane) -> Vec<u8> {
    let mut file = Cursor::new(Vec::new());
    write_focal_plane(plane, &mut file).unwrap();
    file.into_inner()
}

/// A plane that is handed out one step at a time.
struct Small<'a>(Strips<'a>);

impl FocalPlaneSource for Small<'_> {
    fn bands(&self) -> &[Band] {
        self.0.bands()
    }

    fn facts(&self) -> &ExposureFacts {
        self.0.facts()
    }

    fn recorded(&self) -> &Recorded {
        self.0.recorded()
    }

    fn size(&self) -> [usize; 2] {
        self.0.size()
    }

    fn rows_at_once(&self) -> usize {
        STRIP_STEP
    }

    fn next_rows(&mut self, rows: usize) -> Result<FocalPlane, ImageError> {
        assert!(rows <= STRIP_STEP);
        self.0.next_rows(rows)
    }
}

#[test]
fn strips_make_the_file_that_the_whole_makes() {
    let plane = plane();
    // As the library writes it, from channels in memory.
    let mut channels = Vec::new();
    for (name, kind) in Plane::all(&plane.bands, plane.truth.recorded().channels()) {
        let samples = match kind {
            Plane::Mean(b) => FlatSamples::F32(plane.mean.channel(b)),
            Plane::Variance(b) => FlatSamples::F32(plane.variance().channel(b)),
            Plane::HalfDifference(b) => FlatSamples::F32(plane.half_difference.channel(b)),
            Plane::Truth(place, part) => match plane.truth.at(place) {
                Values::Float(raster) => FlatSamples::F32(raster.channel(part)),
                Values::Whole(raster) => FlatSamples::U32(raster.channel(part)),
            },
        };
        channels.push(AnyChannel::new(name.as_str(), samples));
    }
    let mut plain = Cursor::new(Vec::new());
    let set = |_: &mut exr::prelude::ImageAttributes, layer: &mut exr::prelude::LayerAttributes| {
        describe(&plane.bands, plane.truth.recorded(), &plane.facts, layer);
    };
    write_channels((SIZE[0], SIZE[1]), channels, set, &mut plain).unwrap();
    assert_eq!(file(&plane), plain.into_inner());

    let mut by_strips = Cursor::new(Vec::new());
    write_strips(&mut Small(plane.strips()), &mut by_strips).unwrap();
    assert_eq!(by_strips.into_inner(), file(&plane));
}

#[test]
fn strips_of_a_file_are_the_rows_of_the_plane() {
    let plane = plane();
    for steps in [vec![53], vec![16, 16, 16, 5], vec![1, 2, 30, 20], vec![17, 36]] {
        let mut strips = FocalPlaneStrips::open(Cursor::new(file(&plane))).unwrap();
        assert_eq!((strips.size(), strips.bands(), strips.facts()), (SIZE, &plane.bands[..], &plane.facts));
        let mut first = 0;
        for rows in steps {
            assert_eq!(strips.next_rows(rows).unwrap(), plane.rows(first..first + rows), "{first}");
            first += rows;
        }
        assert!(strips.next_rows(1).is_err());
    }
}

#[test]
fn other_orders_are_read_as_a_whole() {
    let plane = plane();
    for (blocks, line_order) in
        [(BlockLayout::Tiles(Vec2(4, 8)), LineOrder::Increasing), (BlockLayout::ScanLines, LineOrder::Decreasing)]
    {
        let mut layer = read_layer(&mut Cursor::new(file(&plane))).unwrap();
        (layer.encoding.blocks, layer.encoding.line_order) = (blocks, line_order);
        let mut other = Cursor::new(Vec::new());
        Image::from_layer(layer).write().to_buffered(&mut other).unwrap();
        other.set_position(0);
        let mut strips = FocalPlaneStrips::open(other).unwrap();
        assert!(matches!(strips.pixels, Pixels::Whole(_)));
        assert_eq!(strips.next_rows(20).unwrap(), plane.rows(0..20));
        assert_eq!(strips.next_rows(33).unwrap(), plane.rows(20..53));
    }
}

#[test]
fn a_file_cut_short_or_without_a_plane_is_an_error() {
    let bytes = file(&plane());
    let cut = FocalPlaneStrips::open(Cursor::new(bytes[..bytes.len() - 40].to_vec()));
    assert!(cut.and_then(|mut strips| strips.next_rows(53)).is_err());
    let place = bytes.windows(9).position(|name| name == b"albedo.G\0").unwrap();
    let mut renamed = bytes;
    renamed[place + 7] = b'H';
    let e = FocalPlaneStrips::open(Cursor::new(renamed)).err().unwrap().to_string();
    assert!(e.contains("\"albedo.G\""), "{e}");
}

#[test]
fn a_source_that_fails_says_why() {
    let plane = plane();
    let mut strips = plane.strips();
    strips.next_rows(10).unwrap();
    let e = write_strips(&mut strips, Cursor::new(Vec::new())).unwrap_err().to_string();
    assert!(e.contains("ends early"), "{e}");
}
