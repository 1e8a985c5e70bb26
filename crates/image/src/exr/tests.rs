use super::*;
use crate::Picture;
use crate::channels::CHANNELS;
use crate::focal_plane::{BandUnit, FocalPlaneSource};
use std::io::Cursor;

fn plane() -> FocalPlane {
    let mut mean = Raster::new(5, 3, 3);
    mean.data.iter_mut().enumerate().for_each(|(i, v)| *v = i as f32 * 0.37);
    let mut half_difference = mean.clone();
    half_difference.data.iter_mut().for_each(|v| *v *= -0.1);
    let mut truth = Truth::empty(5, 3);
    truth.id_mut().data[7] = 4_000_000_000;
    let band = |n: &str| Band { name: n.into(), unit: BandUnit::Electrons };
    FocalPlane {
        bands: ["R", "G", "B"].map(band).to_vec(),
        mean,
        half_difference,
        truth,
        facts: ExposureFacts { body: "a body – 写真 𝄞".into(), f_number: 2.8, ..Default::default() },
    }
}

#[test]
fn a_focal_plane_survives_its_file() {
    let mut file = Cursor::new(Vec::new());
    write_focal_plane(&plane(), &mut file).unwrap();
    file.set_position(0);
    assert_eq!(read_focal_plane(file).unwrap(), plane());
}

/// The plane with every truth channel, each value another one.
fn with_all_truth() -> FocalPlane {
    let mut truth = Truth::missing(Recorded::new(&CHANNELS.iter().collect::<Vec<_>>()), 5, 3);
    for (k, (_, values)) in truth.iter_mut().enumerate() {
        match values {
            Values::Float(raster) => {
                raster.data.iter_mut().enumerate().for_each(|(i, v)| *v = (i as f32 + 0.5) * 1.37f32.powi(k as i32))
            }
            Values::Whole(raster) => raster.data.iter_mut().enumerate().for_each(|(i, v)| *v = u32::MAX - i as u32),
        }
    }
    let recorded = truth.recorded_mut();
    recorded.samples = 64;
    recorded.objects = Arc::new(vec!["Wände".into(), "bunny".into()]);
    recorded.manifests = Arc::new(vec![Manifest::new("CryptoObject", vec!["Wände".into(), "bunny".into()])]);
    recorded.classes = Arc::new(vec!["vase".into()]);
    FocalPlane { truth, ..plane() }
}

#[test]
fn all_truth_survives_its_file_and_a_file_without_is_read_as_before() {
    let plane = with_all_truth();
    let mut file = Cursor::new(Vec::new());
    write_focal_plane(&plane, &mut file).unwrap();
    file.set_position(0);
    assert_eq!(read_focal_plane(file.clone()).unwrap(), plane);
    let mut strips = FocalPlaneStrips::open(file.clone()).unwrap();
    assert_eq!(strips.recorded(), plane.truth.recorded());
    assert_eq!(strips.next_rows(3).unwrap(), plane);
    // Bits of identifiers stay.
    let id = read_plane(file.clone(), "CryptoObject00.R").unwrap();
    assert_eq!(id[2].to_bits(), plane.truth.float("crypto-object").unwrap().pixel(2, 0)[0].to_bits());
    let manifest = read_maps(file, &["forward.u"]).unwrap();
    assert_eq!(manifest.attribute("cryptomatte/3ae39a5/hash"), Some("MurmurHash3_32"));
    assert!(manifest.attribute("cryptomatte/3ae39a5/manifest").unwrap().contains("\"bunny\":\"13851a76\""));
    let mut without = Cursor::new(Vec::new());
    write_focal_plane(&self::plane(), &mut without).unwrap();
    without.set_position(0);
    assert!(FocalPlaneStrips::open(without).unwrap().recorded().more().is_empty());
}

#[test]
fn truth_of_several_parts_is_read_back_part_by_part() {
    let plane = with_all_truth();
    let matte = |part: usize| format!("CryptoObject{:02}.{}", part / 4, ["R", "G", "B", "A"][part % 4]);
    let names: Vec<String> = (0..4).map(matte).collect();
    let [depth, id, light] = [0.5f32, 0.25, 7.0].map(|scale| (0..15).map(|i| i as f32 * scale).collect::<Vec<f32>>());
    let whole: Vec<u32> = (0..15).map(|i| u32::MAX - i).collect();
    let parts = || {
        vec![
            Part { name: "light", floats: vec![("R", light.clone()), ("B", depth.clone())], whole: vec![] },
            Part { name: "depth", floats: vec![("Z", depth.clone())], whole: vec![] },
            Part { name: "id", floats: vec![], whole: vec![("id", whole.clone())] },
            Part { name: "crypto-object", floats: names.iter().map(|n| (n.as_str(), id.clone())).collect(), whole: vec![] },
        ]
    };
    let recorded = plane.truth.recorded();
    let mut file = Cursor::new(Vec::new());
    write_truth([5, 3], parts(), TruthLayout::MultiPart, recorded, &plane.facts, &mut file).unwrap();
    let mut bytes = file.into_inner();
    sort_attributes(&mut bytes).unwrap();
    let image = read().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    let image = image.from_buffered(Cursor::new(&bytes)).unwrap();
    let found: Vec<(String, Vec<String>)> = image
        .layer_data
        .iter()
        .map(|l| {
            let channels = l.channel_data.list.iter().map(|c| c.name.to_string()).collect();
            (l.attributes.layer_name.as_ref().unwrap().to_string(), channels)
        })
        .collect();
    let text = |name: &str, channels: &[&str]| (name.to_owned(), channels.iter().map(|c| (*c).to_owned()).collect::<Vec<_>>());
    let mattes = ["CryptoObject00.A", "CryptoObject00.B", "CryptoObject00.G", "CryptoObject00.R"];
    let expected = [text("light", &["B", "R"]), text("depth", &["Z"]), text("id", &["id"]), text("crypto-object", &mattes)];
    assert_eq!(found, expected);
    // Names stand with their layer and in the first part, and with no other.
    let has = |k: usize, name: &str| image.layer_data[k].attributes.other.contains_key(&Text::from(name));
    assert_eq!([0, 1, 2, 3].map(|k| has(k, "cryptomatte/3ae39a5/manifest")), [true, false, false, true]);
    assert_eq!([0, 1, 2, 3].map(|k| has(k, "diopter.facts")), [true, false, false, false]);
    // Values, whichever part they are in; whole numbers stay whole.
    assert_eq!(read_plane(Cursor::new(&bytes), "R").unwrap(), light);
    assert_eq!(read_plane(Cursor::new(&bytes), "Z").unwrap(), depth);
    let FlatSamples::U32(kept) = &image.layer_data[2].channel_data.list[0].sample_data else { panic!("whole numbers") };
    assert_eq!(kept, &whole);
    assert!(read_plane(Cursor::new(&bytes), "Y").unwrap_err().to_string().contains("\"Y\""));
    // The same channels in one part.
    let mut single = Cursor::new(Vec::new());
    write_truth([5, 3], parts(), TruthLayout::SinglePart, recorded, &plane.facts, &mut single).unwrap();
    single.set_position(0);
    assert_eq!(read_layer(&mut single).unwrap().channel_data.list.len(), 8);
}

#[test]
fn rows_come_one_after_the_other() {
    let mut file = Cursor::new(Vec::new());
    let plane = plane();
    write_focal_plane(&plane, &mut file).unwrap();
    file.set_position(0);
    let mut rows = FocalPlaneRows::open(file.clone()).unwrap();
    assert_eq!((rows.size(), rows.bands(), rows.facts()), ([5, 3], &plane.bands[..], &plane.facts));
    assert_eq!(rows.next(1).unwrap(), plane.mean.data[..15]);
    assert_eq!(rows.next(2).unwrap(), plane.mean.data[15..]);
    assert!(rows.next(1).is_err());
    let bytes = file.into_inner();
    let cut = FocalPlaneRows::open(Cursor::new(bytes[..bytes.len() - 40].to_vec()));
    assert!(cut.and_then(|mut c| c.next(3)).is_err());
}

#[test]
fn a_file_cut_short_is_an_error() {
    let mut file = Cursor::new(Vec::new());
    write_focal_plane(&plane(), &mut file).unwrap();
    let bytes = file.into_inner();
    for length in [0, 3, 40, bytes.len() / 2, bytes.len() - 9] {
        assert!(read_focal_plane(Cursor::new(&bytes[..length])).is_err(), "{length}");
    }
}

/// A file of three half-precision channels with any window, compression and tiles, and 64 bytes in the place of its pixels.
fn announcing([width, height]: [i32; 2], compression: u8, tile: Option<[u32; 2]>) -> Vec<u8> {
    let mut bytes = vec![0x76, 0x2f, 0x31, 0x01, 2, if tile.is_some() { 2 } else { 0 }, 0, 0];
    let mut attribute = |name: &str, kind: &str, value: Vec<u8>| {
        [name, kind].iter().for_each(|text| bytes.extend([text.as_bytes(), &[0]].concat()));
        bytes.extend((value.len() as u32).to_le_bytes());
        bytes.extend(value);
    };
    let words = |values: &[i32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    // A name, the type (half), linear or not with three bytes of padding, the sampling.
    let channel = |name: u8| [vec![name, 0], words(&[1, 0, 1, 1])].concat();
    attribute("channels", "chlist", [channel(b'B'), channel(b'G'), channel(b'R'), vec![0]].concat());
    attribute("compression", "compression", vec![compression]);
    attribute("dataWindow", "box2i", words(&[0, 0, width - 1, height - 1]));
    attribute("displayWindow", "box2i", words(&[0, 0, width - 1, height - 1]));
    attribute("lineOrder", "lineOrder", vec![0]);
    attribute("pixelAspectRatio", "float", 1f32.to_le_bytes().to_vec());
    attribute("screenWindowCenter", "v2f", vec![0; 8]);
    attribute("screenWindowWidth", "float", 1f32.to_le_bytes().to_vec());
    if let Some([across, down]) = tile {
        let level_mode = vec![0];
        attribute("tiles", "tiledesc", [across.to_le_bytes().to_vec(), down.to_le_bytes().to_vec(), level_mode].concat());
    }
    bytes.push(0);
    bytes.extend([0; 64]);
    bytes
}

#[test]
fn more_pixels_than_the_bytes_can_become_are_refused() {
    for compression in 0..10 {
        for size in [[30_000, 30_000], [1_000_000_000, 1], [1_000_000_000, 1_000_000_000]] {
            let bytes = announcing(size, compression, None);
            assert!(bytes.len() < 500);
            let e = read_rgb(Cursor::new(&bytes)).unwrap_err().to_string();
            assert!(e.contains("announced"), "compression {compression}, {size:?}: {e}");
            assert!(read_plane(Cursor::new(&bytes), "R").is_err());
            assert!(FocalPlaneRows::open(Cursor::new(bytes)).is_err());
        }
    }
    // More than the format has at all.
    let e = read_rgb(Cursor::new(announcing([2_000_000_000; 2], 3, None))).unwrap_err().to_string();
    assert!(e.contains("2000000000 × 2000000000 pixels are announced; expected 1 to 1073741823 a side"), "{e}");
    // What the bytes could become passes, and is found to be nonsense later.
    let small = read_rgb(Cursor::new(announcing([8, 8], 3, None))).unwrap_err().to_string();
    assert!(!small.contains("announced"), "{small}");
    let tiles = read_rgb(Cursor::new(announcing([8, 8], 3, Some([1 << 20, 1 << 20])))).unwrap_err().to_string();
    assert!(tiles.contains("blocks of"), "{tiles}");
}

#[test]
fn bands_without_channels_are_refused() {
    let mut many = plane();
    let facts = many.facts.clone();
    many.bands = (0..20).map(|_| many.bands[0].clone()).collect();
    let json = serde_json::to_string(&Description {
        bands: many.bands,
        facts,
        truth_samples: 0,
        objects: Vec::new(),
        classes: Vec::new(),
    })
    .unwrap();
    let set = |_: &mut ImageAttributes, layer: &mut LayerAttributes| {
        layer.other.insert(Text::from(ATTRIBUTE), AttributeValue::Text(Text::from(ascii(&json).as_str())));
    };
    let mut file = Cursor::new(Vec::new());
    let channel = AnyChannel::new("R", FlatSamples::F32(vec![0.0; 15]));
    write_channels((5, 3), vec![channel], set, &mut file).unwrap();
    file.set_position(0);
    let e = read_focal_plane(&mut file).unwrap_err().to_string();
    assert!(e.contains("20 bands"), "{e}");
    file.set_position(0);
    assert!(FocalPlaneRows::open(file).is_err());
}

#[test]
fn a_picture_is_no_focal_plane() {
    let mut pixels = Raster::new(2, 2, 3);
    pixels.data.fill(0.5);
    let picture = Picture { pixels, space: RgbSpace::Srgb, encoding: Encoding::Linear, facts: None };
    let mut file = Cursor::new(Vec::new());
    write_picture(&picture, Precision::Half, &mut file).unwrap();
    file.set_position(0);
    assert!(read_focal_plane(&mut file).unwrap_err().to_string().contains("diopter expose"));
    file.set_position(0);
    assert_eq!(read_rgb(file).unwrap().data, vec![0.5; 12]);
}
