//! OpenEXR: pictures, and focal planes with every plane as a named channel.
//!
//! Channels of a focal plane: the bands (`R`, `G`, `B` ...), `variance.<band>` (for readers) and `half_difference.<band>`
//! (what it is computed from, see [`FocalPlane`]), and the truth by the names of its table ([`crate::channels`]): `Z` (depth, m), `normal.X/Y/Z` ... The
//! bands and the facts of the exposure are JSON in the attribute `diopter`. Spectral bands are named `S0.405,0nm` and marked as such for
//! other programs: Fichet, Pacanowski & Wilkie 2021, "An OpenEXR layout for spectral images" (JCGT 10(3)).

use crate::channels;
use crate::cryptomatte;
use crate::focal_plane::{Band, Truth};
use crate::picture::in_bands;
use crate::streams::{ReadSeek, WriteSeek, beginning, foreign};
use crate::truth::{Manifest, Recorded, Values};
use crate::{Encoding, ExposureFacts, FocalPlane, ImageError, PictureSource, Raster};
use diopter_light::color::RgbSpace;
use exr::prelude::*;
use std::io::{Read, Seek, SeekFrom, Write};
use std::sync::Arc;

mod attributes;
mod strips;

pub use attributes::{sort_attributes, sort_attributes_in};
pub use strips::{FocalPlaneRows, FocalPlaneStrips, write_focal_plane, write_strips};

const ATTRIBUTE: &str = "diopter";

/// Bits of the floating-point numbers of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Precision {
    /// 16 bits.
    Half,
    /// 32 bits.
    Float,
}

#[derive(serde::Serialize, serde::Deserialize)]
struct Description {
    bands: Vec<Band>,
    facts: ExposureFacts,
    /// [`Recorded::samples`]
    #[serde(default, skip_serializing_if = "is_zero")]
    truth_samples: u32,
    /// [`Recorded::objects`]
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    objects: Vec<String>,
    /// [`Recorded::classes`]
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    classes: Vec<String>,
}

fn is_zero(n: &u32) -> bool {
    *n == 0
}

impl Description {
    /// The truth of a file with such channels.
    fn recorded<C>(
        &self,
        attributes: &LayerAttributes,
        channels: &[C],
        name: impl Fn(&C) -> &Text,
    ) -> std::result::Result<Recorded, ImageError> {
        let found = channels::found_in(|wanted| channels.iter().any(|c| *name(c) == *wanted))?;
        let mut recorded = Recorded::new(&found);
        (recorded.samples, recorded.objects) = (self.truth_samples, Arc::new(self.objects.clone()));
        recorded.classes = Arc::new(self.classes.clone());
        let text = |(name, value): (&Text, &AttributeValue)| match value {
            AttributeValue::Text(text) => Some((name.to_string(), text.to_string())),
            _ => None,
        };
        let texts: Vec<(String, String)> =
            attributes.other.iter().filter(|(name, _)| name.to_string().starts_with("cryptomatte/")).filter_map(text).collect();
        recorded.manifests = Arc::new(cryptomatte::manifests(&texts));
        Ok(recorded)
    }
}

fn malformed(e: exr::error::Error) -> ImageError {
    ImageError::Malformed { format: "EXR", reason: e.to_string() }
}

fn written(e: exr::error::Error) -> ImageError {
    match e {
        exr::error::Error::Io(e) => ImageError::Io(e),
        other => ImageError::Io(std::io::Error::other(other.to_string())),
    }
}

fn chromaticities(space: RgbSpace) -> attribute::Chromaticities {
    let ([red, green, blue], white) = space.chromaticities();
    let vec = |p: (f64, f64)| Vec2(p.0 as f32, p.1 as f32);
    attribute::Chromaticities { red: vec(red), green: vec(green), blue: vec(blue), white: vec(white) }
}

/// JSON with everything beyond ASCII escaped: EXR texts hold Latin-1 only.
fn ascii(json: &str) -> String {
    let mut text = String::with_capacity(json.len());
    for c in json.chars() {
        if c.is_ascii() {
            text.push(c);
        } else {
            c.encode_utf16(&mut [0; 2]).iter().for_each(|unit| text.push_str(&format!("\\u{unit:04x}")));
        }
    }
    text
}

/// A file of one layer.
fn image_of(
    size: (usize, usize),
    channels: Vec<AnyChannel<FlatSamples>>,
    set: impl FnOnce(&mut ImageAttributes, &mut LayerAttributes),
) -> Image<Layer<AnyChannels<FlatSamples>>> {
    let layer = Layer::new(size, LayerAttributes::default(), block_layout(), AnyChannels::sort(channels.into_iter().collect()));
    let mut image = Image::from_layer(layer);
    set(&mut image.attributes, &mut image.layer_data.attributes);
    image
}

fn write_channels(
    size: (usize, usize),
    channels: Vec<AnyChannel<FlatSamples>>,
    set: impl FnOnce(&mut ImageAttributes, &mut LayerAttributes),
    to: &mut dyn WriteSeek,
) -> std::result::Result<(), ImageError> {
    image_of(size, channels, set).write().to_buffered(to).map_err(written)
}

/// Compression and block layout of what we write.
fn block_layout() -> exr::image::Encoding {
    exr::image::Encoding {
        compression: Compression::ZIP16,
        blocks: exr::image::Blocks::ScanLines,
        line_order: LineOrder::Increasing,
    }
}

/// Writes a picture, linear whatever it is encoded in, with its primaries. Fails where writing does.
pub fn write_picture(
    picture: &dyn PictureSource,
    precision: Precision,
    mut to: impl Write + Seek,
) -> std::result::Result<(), ImageError> {
    write_picture_to(picture, precision, &mut to)
}

fn write_picture_to(
    picture: &dyn PictureSource,
    precision: Precision,
    to: &mut dyn WriteSeek,
) -> std::result::Result<(), ImageError> {
    let [width, height] = picture.size();
    let encoding = picture.encoding();
    let luminance = picture.space().luminance_weights();
    let mut planes: [Planes; 3] = std::array::from_fn(|_| Planes::new(precision, width * height));
    let linear = |first: usize, count: usize| {
        let mut rows = picture.rows(first, count);
        if encoding != Encoding::Linear {
            rows.as_chunks_mut::<3>().0.iter_mut().for_each(|p| *p = encoding.decode_pixel(*p, luminance));
        }
        Ok(rows)
    };
    in_bands(height, picture.rows_at_once(), linear, |rows| {
        for (c, plane) in planes.iter_mut().enumerate() {
            plane.extend(rows.iter().skip(c).step_by(3).copied());
        }
        Ok(())
    })?;
    let channels = ["R", "G", "B"].iter().zip(planes).map(|(name, plane)| AnyChannel::new(*name, plane.samples())).collect();
    write_channels((width, height), channels, |image, _| image.chromaticities = Some(chromaticities(picture.space())), to)
}

/// One channel on its way to a file.
enum Planes {
    Half(Vec<f16>),
    Float(Vec<f32>),
}

impl Planes {
    fn new(precision: Precision, size: usize) -> Self {
        match precision {
            Precision::Half => Planes::Half(Vec::with_capacity(size)),
            Precision::Float => Planes::Float(Vec::with_capacity(size)),
        }
    }

    fn extend(&mut self, values: impl Iterator<Item = f32>) {
        match self {
            Planes::Half(to) => to.extend(values.map(f16::from_f32)),
            Planes::Float(to) => to.extend(values),
        }
    }

    fn samples(self) -> FlatSamples {
        match self {
            Planes::Half(v) => FlatSamples::F16(v),
            Planes::Float(v) => FlatSamples::F32(v),
        }
    }
}

/// Describes a focal plane in the attributes of its layer.
fn describe(bands: &[Band], recorded: &Recorded, facts: &ExposureFacts, layer: &mut LayerAttributes) {
    let (truth_samples, objects) = (recorded.samples, recorded.objects.to_vec());
    let classes = recorded.classes.to_vec();
    let description = Description { bands: bands.to_vec(), facts: facts.clone(), truth_samples, objects, classes };
    let json = serde_json::to_string(&description).expect("plain data becomes JSON");
    layer.software_name = Text::new_or_none(&facts.software);
    describe_mattes(recorded.manifests.iter(), layer);
    layer.other.insert(Text::from(ATTRIBUTE), AttributeValue::Text(Text::from(ascii(&json).as_str())));
    if bands.iter().any(|b| b.name.starts_with("S0.")) {
        // Values are per nm, the unit is written as the layout has it.
        for (name, text) in [("spectralLayoutVersion", "1.0"), ("emissiveUnits", "W.m^-2.sr^-1")] {
            layer.other.insert(Text::from(name), AttributeValue::Text(Text::from(text)));
        }
    }
}

/// Says in the attributes of a layer what identifiers stand for.
fn describe_names(recorded: &Recorded, layer: &mut LayerAttributes) {
    let lists = [("diopter.objects", &recorded.objects), ("diopter.classes", &recorded.classes)];
    for (name, names) in lists.into_iter().filter(|(_, names)| !names.is_empty()) {
        let json = serde_json::to_string(names.as_ref()).expect("texts become JSON");
        layer.other.insert(Text::from(name), AttributeValue::Text(Text::from(ascii(&json).as_str())));
    }
    describe_mattes(recorded.manifests.iter(), layer);
}

/// Says what the identifiers of coverage stand for, as Cryptomatte has it.
fn describe_mattes<'a>(manifests: impl Iterator<Item = &'a Manifest>, layer: &mut LayerAttributes) {
    for (name, text) in manifests.flat_map(cryptomatte::metadata) {
        layer.other.insert(Text::from(name.as_str()), AttributeValue::Text(Text::from(ascii(&text).as_str())));
    }
}

fn description(attributes: &LayerAttributes) -> std::result::Result<Description, ImageError> {
    let Some(AttributeValue::Text(json)) = attributes.other.get(&Text::from(ATTRIBUTE)) else {
        return Err(ImageError::Missing {
            what: "the attribute \"diopter\"".into(),
            hint: "it is no focal plane of `diopter expose`; a picture of light is read out with --exposure TIME and --irradiance or --t-stop".into(),
        });
    };
    serde_json::from_str(&json.to_string()).map_err(|e| ImageError::Malformed { format: "focal plane", reason: e.to_string() })
}

/// Each band has a channel of its own, so there are no more bands than channels: memory is asked for by the number of bands.
fn few_bands(description: &Description, channels: usize) -> std::result::Result<(), ImageError> {
    let bands = description.bands.len();
    match bands <= channels {
        true => Ok(()),
        false => Err(ImageError::Malformed {
            format: "focal plane",
            reason: format!("{bands} bands are announced, and the file has {channels} channels: expected a channel for each"),
        }),
    }
}

/// How the channels of a file of truth are laid out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub enum TruthLayout {
    /// All in one part.
    #[default]
    SinglePart,
    /// Each group of channels in a part of its own, which has its name (OpenEXR 2.0, multi-part files).
    MultiPart,
}

/// Channels that belong together.
#[derive(Clone, Debug, Default)]
pub struct Part<'a> {
    /// Name of the part.
    pub name: &'a str,
    /// Channels of floating-point numbers by name, row by row.
    pub floats: Vec<(&'a str, Vec<f32>)>,
    /// Channels of whole numbers.
    pub whole: Vec<(&'a str, Vec<u32>)>,
}

impl Part<'_> {
    fn channels(self) -> impl Iterator<Item = AnyChannel<FlatSamples>> {
        let floats = self.floats.into_iter().map(|(n, v)| AnyChannel::new(n, FlatSamples::F32(v)));
        floats.chain(self.whole.into_iter().map(|(n, v)| AnyChannel::new(n, FlatSamples::U32(v))))
    }
}

/// Writes planes of one pixel raster (`size`: columns, rows) by name, row by row: floating point, and whole numbers. Fails where writing does.
pub fn write_planes(
    size: [usize; 2],
    floats: Vec<(&str, Vec<f32>)>,
    whole: Vec<(&str, Vec<u32>)>,
    facts: &ExposureFacts,
    to: impl Write + Seek,
) -> std::result::Result<(), ImageError> {
    write_truth(size, vec![Part { name: "", floats, whole }], TruthLayout::SinglePart, &Recorded::default(), facts, to)
}

/// [`write_planes`] with truth among them: `recorded` says what its identifiers stand for.
///
/// Channels have the same names in both layouts. Of several parts the first says all that a file of one part says; the metadata of Cryptomatte stand in the
/// part of their layer, too. Fails where writing does.
pub fn write_truth(
    size: [usize; 2],
    parts: Vec<Part>,
    layout: TruthLayout,
    recorded: &Recorded,
    facts: &ExposureFacts,
    mut to: impl Write + Seek,
) -> std::result::Result<(), ImageError> {
    write_truth_to(size, parts, layout, recorded, facts, &mut to)
}

fn write_truth_to(
    [width, height]: [usize; 2],
    parts: Vec<Part>,
    layout: TruthLayout,
    recorded: &Recorded,
    facts: &ExposureFacts,
    to: &mut dyn WriteSeek,
) -> std::result::Result<(), ImageError> {
    let json = serde_json::to_string(facts).expect("plain data becomes JSON");
    let describe = |layer: &mut LayerAttributes| {
        layer.software_name = Text::new_or_none(&facts.software);
        layer.other.insert(Text::from("diopter.facts"), AttributeValue::Text(Text::from(ascii(&json).as_str())));
        describe_names(recorded, layer);
    };
    if layout == TruthLayout::SinglePart {
        let channels = parts.into_iter().flat_map(Part::channels).collect();
        return write_channels((width, height), channels, |_, layer| describe(layer), to);
    }
    let layer = |(k, part): (usize, Part)| {
        let mut attributes = LayerAttributes::named(part.name);
        let holds = |manifest: &&Manifest| part.floats.iter().any(|(name, _)| name.starts_with(manifest.layer.as_str()));
        describe_mattes(recorded.manifests.iter().filter(holds), &mut attributes);
        if k == 0 {
            describe(&mut attributes);
        }
        Layer::new((width, height), attributes, block_layout(), AnyChannels::sort(part.channels().collect()))
    };
    let layers: Layers<AnyChannels<FlatSamples>> = parts.into_iter().enumerate().map(layer).collect();
    let window = IntegerBounds::from_dimensions((width, height));
    Image::from_layers(ImageAttributes::new(window), layers).write().to_buffered(to).map_err(written)
}

/// Reads a focal plane that [`write_focal_plane`] wrote. Fails where reading does, and on files that are no EXR, lack our description or a channel, or announce more pixels
/// than they can hold.
pub fn read_focal_plane(mut from: impl Read + Seek) -> std::result::Result<FocalPlane, ImageError> {
    read_focal_plane_from(&mut from)
}

fn read_focal_plane_from(from: &mut dyn ReadSeek) -> std::result::Result<FocalPlane, ImageError> {
    let layer = read_layer(from)?;
    let (width, height) = (layer.size.0, layer.size.1);
    let description = description(&layer.attributes)?;
    few_bands(&description, layer.channel_data.list.len())?;
    let find = |name: &str| {
        layer.channel_data.list.iter().find(|c| c.name == *name).ok_or_else(|| ImageError::Missing {
            what: format!("the channel \"{name}\""),
            hint: "the file was written or cut by another program".into(),
        })
    };
    let gather = |names: Vec<String>| -> std::result::Result<Raster<f32>, ImageError> {
        let mut raster = Raster::new(width, height, names.len());
        for (c, name) in names.iter().enumerate() {
            for (i, value) in find(name)?.sample_data.values_as_f32().enumerate() {
                raster.data[i * names.len() + c] = value;
            }
        }
        Ok(raster)
    };
    let bands = |prefix: &str| description.bands.iter().map(|b| format!("{prefix}{}", b.name)).collect::<Vec<_>>();
    let recorded = description.recorded(&layer.attributes, &layer.channel_data.list, |channel| &channel.name)?;
    let mut truth = Truth::missing(recorded, width, height);
    for (channel, values) in truth.iter_mut() {
        match values {
            Values::Float(raster) => *raster = gather(channel.exr.iter().map(|name| (*name).to_owned()).collect())?,
            Values::Whole(raster) => {
                for (part, name) in channel.exr.iter().enumerate() {
                    // What another program made floating numbers of is no object's number.
                    let FlatSamples::U32(values) = &find(name)?.sample_data else { continue };
                    let to = raster.data[part..].iter_mut().step_by(channel.parts());
                    to.zip(values).for_each(|(to, value)| *to = *value);
                }
            }
        }
    }
    Ok(FocalPlane {
        mean: gather(bands(""))?,
        half_difference: gather(bands("half_difference."))?,
        truth,
        bands: description.bands,
        facts: description.facts,
    })
}

fn read_layer(from: &mut dyn ReadSeek) -> std::result::Result<Layer<AnyChannels<FlatSamples>>, ImageError> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_chunks(open(from)?)
        .map_err(malformed)?;
    Ok(image.layer_data)
}

/// Most bytes of one block (a tile, or the rows that are compressed together) that need not be part of the picture: blocks are unpacked
/// whole. A tile of 2048 × 2048 pixels of four 32-bit numbers.
const LARGEST_BLOCK: usize = 64 << 20;

/// The first bytes of every EXR.
const MAGIC: [u8; 4] = [0x76, 0x2f, 0x31, 0x01];

/// Pixels a side, and farthest from the origin, that OpenEXR has (`INT_MAX / 2` in its `ImfHeader`).
const LARGEST_CORNER: i64 = (i32::MAX / 2) as i64;

/// Reads the headers, and holds the pixels that they announce against the bytes of the file: before any memory is asked for.
fn open<R: Read + Seek>(from: R) -> std::result::Result<exr::block::reader::Reader<std::io::BufReader<R>>, ImageError> {
    let mut from = std::io::BufReader::new(from);
    let begins = beginning(&mut from, 8192)?;
    if !begins.starts_with(&MAGIC) {
        return Err(foreign("EXR", &begins[..begins.len().min(64)], "an EXR file (diopter develop takes raw files)"));
    }
    let start = from.stream_position()?;
    let length = from.seek(SeekFrom::End(0))?.saturating_sub(start);
    from.seek(SeekFrom::Start(start))?;
    let reader = exr::block::read(from, false).map_err(|e| too_large(&begins).unwrap_or_else(|| malformed(e)))?;
    reader.headers().iter().try_for_each(|header| within_file(header, length))?;
    Ok(reader)
}

/// The error of a file whose header tells a larger picture than the format has. The reader does not say which.
fn too_large(header: &[u8]) -> Option<ImageError> {
    const WINDOW: &[u8] = b"dataWindow\0box2i\0\x10\0\0\0";
    let at = header.windows(WINDOW.len()).position(|w| w == WINDOW)? + WINDOW.len();
    let corners: Vec<i64> =
        header.get(at..at + 16)?.as_chunks::<4>().0.iter().map(|b| i64::from(i32::from_le_bytes(*b))).collect();
    let [width, height] = [corners[2] - corners[0] + 1, corners[3] - corners[1] + 1];
    let beyond = corners.iter().any(|c| c.abs() >= LARGEST_CORNER) || !(1..=LARGEST_CORNER).contains(&width.min(height));
    beyond.then(|| ImageError::Malformed {
        format: "EXR",
        reason: format!(
            "{width} × {height} pixels are announced; expected 1 to {LARGEST_CORNER} a side, within as many of the origin"
        ),
    })
}

/// Most bytes of pixels that a byte of a file can become.
///
/// Run lengths: 128 equal bytes from 2. Deflate: 258 bytes from 2 bits (RFC 1951). PXR24: deflate of 24 of 32 bits. PIZ: Huffman codes of which
/// a run of 255 numbers of 16 bits takes 9 bits at least. B44: 16 numbers of 16 bits from 3 bytes. DWA: 64 numbers of 32 bits from two
/// numbers of 16 bits (a constant and the end of its block), deflated. Source: OpenEXR, "Technical Introduction" and its `ImfPizCompressor`,
/// `ImfB44Compressor`, `ImfDwaCompressor`. `None`: not readable here.
fn largest_expansion(compression: Compression) -> Option<usize> {
    Some(match compression {
        Compression::Uncompressed => 1,
        Compression::RLE => 64,
        Compression::ZIP1 | Compression::ZIP16 => 1032,
        Compression::PXR24 => 1376,
        Compression::PIZ => 454,
        Compression::B44 | Compression::B44A => 11,
        Compression::DWAA(_) | Compression::DWAB(_) => 66_048,
        _ => return None,
    })
}

/// Whether a file of `length` bytes can hold the pixels that a header announces.
fn within_file(header: &exr::meta::header::Header, length: u64) -> std::result::Result<(), ImageError> {
    let wrong = |reason: String| Err(ImageError::Malformed { format: "EXR", reason });
    let Some(expansion) = largest_expansion(header.compression) else {
        return wrong(format!("its pixels have {}: expected none, RLE, ZIP, PIZ, PXR24, B44 or DWA", header.compression));
    };
    let pixel = header.channels.list.iter().map(|c| c.sample_type.bytes_per_sample()).sum::<usize>();
    let bytes = |Vec2(width, height): Vec2<usize>| width.checked_mul(height).and_then(|n| n.checked_mul(pixel));
    let whole = bytes(header.layer_size);
    let most = usize::try_from(length).unwrap_or(usize::MAX).saturating_mul(expansion);
    let Vec2(width, height) = header.layer_size;
    if whole.is_none_or(|n| n > most) {
        return wrong(format!(
            "{width} × {height} pixels of {pixel} bytes are announced, and with {} its {length} bytes can become {most} at most: it is \
             cut short or damaged",
            header.compression
        ));
    }
    let block = match header.blocks {
        exr::meta::BlockDescription::Tiles(tiles) => tiles.tile_size,
        exr::meta::BlockDescription::ScanLines => Vec2(width, header.compression.scan_lines_per_block()),
    };
    if bytes(block).is_none_or(|n| n > whole.unwrap_or(0).max(LARGEST_BLOCK)) {
        return wrong(format!(
            "blocks of {} × {} pixels of {pixel} bytes: expected at most {} MiB, or the {width} × {height} pixels of the picture",
            block.0,
            block.1,
            LARGEST_BLOCK >> 20
        ));
    }
    Ok(())
}

/// Reads one channel of any EXR by name, as floating point, row by row; of several parts that have it, of the first. Fails where reading does, on files that are no EXR or are
/// damaged, and where no part has the channel.
pub fn read_plane(mut from: impl Read + Seek, name: &str) -> std::result::Result<Vec<f32>, ImageError> {
    read_plane_from(&mut from, name)
}

fn read_plane_from(from: &mut dyn ReadSeek, name: &str) -> std::result::Result<Vec<f32>, ImageError> {
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_chunks(open(from)?)
        .map_err(malformed)?;
    let found = image.layer_data.iter().flat_map(|layer| &layer.channel_data.list).find(|c| c.name == *name);
    let channel = found.ok_or_else(|| ImageError::Missing {
        what: format!("the channel \"{name}\""),
        hint: "see its list of channels".into(),
    })?;
    Ok(channel.sample_data.values_as_f32().collect())
}

/// Writes channels of one raster in 32 bits, with texts as attributes: maps of places and directions. Each channel holds width × height values, row by row. Fails where writing
/// does.
pub fn write_maps(
    [width, height]: [usize; 2],
    planes: Vec<(&str, Vec<f32>)>,
    attributes: &[(&str, &str)],
    mut to: impl Write + Seek,
) -> std::result::Result<(), ImageError> {
    let channels = planes.into_iter().map(|(n, v)| AnyChannel::new(n, FlatSamples::F32(v))).collect();
    let set = |_: &mut ImageAttributes, layer: &mut LayerAttributes| {
        for (name, text) in attributes {
            layer.other.insert(Text::from(*name), AttributeValue::Text(Text::from(ascii(text).as_str())));
        }
    };
    write_channels((width, height), channels, set, &mut to)
}

/// Channels of an EXR by name, and its attributes.
pub struct Maps {
    /// Columns and rows.
    pub size: [usize; 2],
    /// In the order in which they were asked for.
    pub planes: Vec<Vec<f32>>,
    /// Attributes that are texts.
    texts: Vec<(String, String)>,
}

impl Maps {
    /// The text of an attribute.
    pub fn attribute(&self, name: &str) -> Option<&str> {
        self.texts.iter().find(|t| t.0 == name).map(|t| t.1.as_str())
    }
}

/// Reads channels of any EXR by name, as floating point, row by row. Fails where reading does, on files that are no EXR or are damaged, and on a channel that is not there.
pub fn read_maps(mut from: impl Read + Seek, names: &[&str]) -> std::result::Result<Maps, ImageError> {
    let layer = read_layer(&mut from)?;
    let plane = |name: &&str| {
        let found = layer.channel_data.list.iter().find(|c| c.name == **name);
        let channel = found.ok_or_else(|| ImageError::Missing {
            what: format!("the channel \"{name}\""),
            hint: "see its list of channels".into(),
        })?;
        Ok::<_, ImageError>(channel.sample_data.values_as_f32().collect())
    };
    let planes = names.iter().map(plane).collect::<std::result::Result<Vec<Vec<f32>>, _>>()?;
    let text = |(name, value): (&Text, &AttributeValue)| match value {
        AttributeValue::Text(text) => Some((name.to_string(), text.to_string())),
        _ => None,
    };
    Ok(Maps { size: [layer.size.0, layer.size.1], planes, texts: layer.attributes.other.iter().filter_map(text).collect() })
}

/// Reads the `R`, `G`, `B` channels of any EXR (or one channel three times), as linear numbers: environment maps, light from elsewhere. `[row][column][3]`. Fails where reading does, on files that
/// are no EXR or are damaged, and where neither these channels nor `Y` are there.
pub fn read_rgb(mut from: impl Read + Seek) -> std::result::Result<Raster<f32>, ImageError> {
    let layer = read_layer(&mut from)?;
    let list = &layer.channel_data.list;
    let find = |name: &str| list.iter().find(|c| c.name.eq_case_insensitive(name));
    let names = [["R", "Y"], ["G", "Y"], ["B", "Y"]];
    let (width, height) = (layer.size.0, layer.size.1);
    let mut raster = Raster::new(width, height, 3);
    for (c, candidates) in names.iter().enumerate() {
        let channel = candidates.iter().find_map(|n| find(n)).ok_or_else(|| ImageError::Missing {
            what: format!("the channel \"{}\"", candidates[0]),
            hint: "a picture of light needs channels R, G and B (or Y)".into(),
        })?;
        for (i, value) in channel.sample_data.values_as_f32().enumerate() {
            raster.data[i * 3 + c] = value;
        }
    }
    Ok(raster)
}

#[cfg(test)]
mod tests;
