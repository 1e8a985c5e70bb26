//! The truth beside an exposure: the values of the channels that were recorded ([`crate::channels`]).

pub use crate::cryptomatte::Manifest;

use crate::channels::{ALWAYS, CHANNELS, Channel, Merge, PixelType};
use crate::{ImageError, Raster};
use std::ops::Range;
use std::sync::Arc;

/// Which channels are recorded, and what is said of them once and not pixel by pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct Recorded {
    /// Channels, those that are always recorded first.
    channels: Vec<&'static Channel>,
    /// Samples a pixel behind the channels that are weighted by coverage: what parts are weighted by when they merge.
    pub samples: u32,
    /// Names of the scene's objects, by number; empty where nobody asked for more than what is always recorded.
    pub objects: Arc<Vec<String>>,
    /// Names of their classes, by number; empty where nobody asked for classes.
    pub classes: Arc<Vec<String>>,
    /// Names behind the identifiers of coverage.
    pub manifests: Arc<Vec<Manifest>>,
}

impl Default for Recorded {
    /// What is always recorded.
    fn default() -> Self {
        Recorded::new(&[])
    }
}

impl Recorded {
    /// What is always recorded, and these.
    pub fn new(more: &[&'static Channel]) -> Self {
        let more = more.iter().copied().filter(|c| !c.is_always());
        let channels = CHANNELS[..ALWAYS].iter().chain(more).collect();
        Recorded { channels, samples: 0, objects: Arc::default(), classes: Arc::default(), manifests: Arc::default() }
    }

    /// Channels, those that are always recorded first.
    pub fn channels(&self) -> &[&'static Channel] {
        &self.channels
    }

    /// Channels beyond those that are always recorded.
    pub fn more(&self) -> &[&'static Channel] {
        &self.channels[ALWAYS..]
    }

    /// Bytes of a pixel of all channels in memory.
    pub fn bytes(&self) -> usize {
        self.channels.iter().map(|c| c.bytes()).sum()
    }

    /// Bytes of a pixel of the channels beyond those that are always recorded.
    pub fn more_bytes(&self) -> usize {
        self.more().iter().map(|c| c.bytes()).sum()
    }

    /// The same for an EXR file with its names in files beside it: of `truth.exr` (`stem` is "truth") they are called `truth.CryptoObject.json` ...
    pub fn beside(&self, stem: &str) -> Recorded {
        let named = |m: &Manifest| Manifest { sidecar: Some(format!("{stem}.{}.json", m.layer)), ..m.clone() };
        Recorded { manifests: Arc::new(self.manifests.iter().map(named).collect()), ..self.clone() }
    }

    /// What both have recorded.
    pub(crate) fn common(&self, other: &Recorded) -> Recorded {
        let channels = self.channels.iter().copied().filter(|c| other.channels.contains(c)).collect();
        Recorded { channels, ..self.clone() }
    }
}

/// The values of a channel, `[row][column][part]`.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Of [`PixelType::Float`].
    Float(Raster<f32>),
    /// Of [`PixelType::Whole`].
    Whole(Raster<u32>),
}

impl Values {
    fn missing(channel: &Channel, width: usize, height: usize) -> Values {
        match channel.numbers {
            PixelType::Float => {
                let mut raster = Raster::new(width, height, channel.parts());
                raster.data.fill(channel.missing);
                Values::Float(raster)
            }
            PixelType::Whole => Values::Whole(Raster::new(width, height, channel.parts())),
        }
    }

    fn rows(&self, rows: Range<usize>) -> Values {
        match self {
            Values::Float(raster) => Values::Float(raster.rows(rows)),
            Values::Whole(raster) => Values::Whole(raster.rows(rows)),
        }
    }

    fn thinned(&self, factor: usize) -> Values {
        match self {
            Values::Float(raster) => Values::Float(raster.thinned(factor)),
            Values::Whole(raster) => Values::Whole(raster.thinned(factor)),
        }
    }

    fn check_below(&self, below: &Values) -> Result<(), ImageError> {
        match (self, below) {
            (Values::Float(raster), Values::Float(below)) => raster.check_below(below),
            (Values::Whole(raster), Values::Whole(below)) => raster.check_below(below),
            _ => Err(ImageError::Mismatch("rows of other truth channels".into())),
        }
    }

    fn append(&mut self, below: &Values) -> Result<(), ImageError> {
        match (self, below) {
            (Values::Float(raster), Values::Float(below)) => raster.append(below),
            (Values::Whole(raster), Values::Whole(below)) => raster.append(below),
            _ => Err(ImageError::Mismatch("rows of other truth channels".into())),
        }
    }
}

/// Ground truth, pixel by pixel ([`crate::channels`] says along which rays).
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    recorded: Recorded,
    /// In the order of `recorded`.
    values: Vec<Values>,
}

impl Truth {
    /// Nothing hit anywhere, only what is always recorded.
    pub fn empty(width: usize, height: usize) -> Self {
        Truth::missing(Recorded::default(), width, height)
    }

    /// Nothing hit anywhere.
    pub fn missing(recorded: Recorded, width: usize, height: usize) -> Self {
        let values = recorded.channels.iter().map(|c| Values::missing(c, width, height)).collect();
        Truth { recorded, values }
    }

    /// What is recorded.
    pub fn recorded(&self) -> &Recorded {
        &self.recorded
    }

    /// What is recorded, to change what is said of it.
    pub fn recorded_mut(&mut self) -> &mut Recorded {
        &mut self.recorded
    }

    /// Channels and their values.
    pub fn iter(&self) -> impl Iterator<Item = (&'static Channel, &Values)> {
        self.recorded.channels.iter().copied().zip(&self.values)
    }

    /// Channels and their values, to change.
    pub fn iter_mut(&mut self) -> impl Iterator<Item = (&'static Channel, &mut Values)> {
        self.recorded.channels.iter().copied().zip(&mut self.values)
    }

    /// The values of a channel by its name; `None` where it was not recorded.
    pub fn values(&self, name: &str) -> Option<&Values> {
        self.iter().find(|(c, _)| c.name == name).map(|(_, values)| values)
    }

    /// The values of a channel of floating-point numbers by its name; `None` where it was not recorded.
    pub fn float(&self, name: &str) -> Option<&Raster<f32>> {
        match self.values(name)? {
            Values::Float(raster) => Some(raster),
            Values::Whole(_) => None,
        }
    }

    /// The values at a place of `recorded`.
    pub(crate) fn at(&self, place: usize) -> &Values {
        &self.values[place]
    }

    /// The same, to change.
    pub(crate) fn at_mut(&mut self, place: usize) -> &mut Values {
        &mut self.values[place]
    }

    fn always(&self, place: usize) -> &Raster<f32> {
        match &self.values[place] {
            Values::Float(raster) => raster,
            Values::Whole(_) => unreachable!("channel {place} of the table has floating-point numbers"),
        }
    }

    fn always_mut(&mut self, place: usize) -> &mut Raster<f32> {
        match &mut self.values[place] {
            Values::Float(raster) => raster,
            Values::Whole(_) => unreachable!("channel {place} of the table has floating-point numbers"),
        }
    }

    /// Distance along the camera's axis, m; infinite where nothing is hit.
    pub fn depth(&self) -> &Raster<f32> {
        self.always(0)
    }

    /// [`Truth::depth`], to change.
    pub fn depth_mut(&mut self) -> &mut Raster<f32> {
        self.always_mut(0)
    }

    /// World-space shading normal towards the camera; 0 where nothing is hit.
    pub fn normal(&self) -> &Raster<f32> {
        self.always(1)
    }

    /// [`Truth::normal`], to change.
    pub fn normal_mut(&mut self) -> &mut Raster<f32> {
        self.always_mut(1)
    }

    /// Albedo, linear sRGB.
    pub fn albedo(&self) -> &Raster<f32> {
        self.always(2)
    }

    /// [`Truth::albedo`], to change.
    pub fn albedo_mut(&mut self) -> &mut Raster<f32> {
        self.always_mut(2)
    }

    /// Object number + 1; 0 where nothing is hit.
    pub fn id(&self) -> &Raster<u32> {
        match &self.values[3] {
            Values::Whole(raster) => raster,
            Values::Float(_) => unreachable!("channel 3 of the table has whole numbers"),
        }
    }

    /// [`Truth::id`], to change.
    pub fn id_mut(&mut self) -> &mut Raster<u32> {
        match &mut self.values[3] {
            Values::Whole(raster) => raster,
            Values::Float(_) => unreachable!("channel 3 of the table has whole numbers"),
        }
    }

    /// Some of its rows. Panics on rows that it does not have.
    pub fn rows(&self, rows: Range<usize>) -> Truth {
        Truth { recorded: self.recorded.clone(), values: self.values.iter().map(|v| v.rows(rows.clone())).collect() }
    }

    /// That of the pixel in the middle of each block of `factor` × `factor`.
    pub(crate) fn thinned(&self, factor: usize) -> Truth {
        Truth { recorded: self.recorded.clone(), values: self.values.iter().map(|v| v.thinned(factor)).collect() }
    }

    /// Adds the rows of a truth below its own. Fails, and adds nothing, on other channels or another width.
    pub fn append(&mut self, below: &Truth) -> Result<(), ImageError> {
        self.check_below(below)?;
        self.values.iter_mut().zip(&below.values).try_for_each(|(v, below)| v.append(below))
    }

    /// Fails where the rows of another truth do not fit below its own.
    pub(crate) fn check_below(&self, below: &Truth) -> Result<(), ImageError> {
        if self.recorded.channels != below.recorded.channels {
            return Err(ImageError::Mismatch("rows of other truth channels".into()));
        }
        self.values.iter().zip(&below.values).try_for_each(|(v, below)| v.check_below(below))
    }

    /// Only the channels of `recorded`, all of which must be there.
    pub(crate) fn only(mut self, recorded: &Recorded) -> Truth {
        let (samples, channels) = (self.recorded.samples, std::mem::take(&mut self.recorded.channels));
        let values = channels.into_iter().zip(self.values).filter(|(c, _)| recorded.channels.contains(c)).map(|(_, v)| v);
        Truth { values: values.collect(), recorded: Recorded { samples, ..recorded.clone() } }
    }

    /// Merges the truth of other samples of the same pixels and channels into this one; channels of one ray stay as they are. `samples` of the picture are
    /// behind this and the other.
    pub(crate) fn merge(&mut self, other: &Truth, samples: [f64; 2]) {
        // Parts of 0 samples bring nothing.
        let weights = |[own, others]: [f64; 2]| if others > 0.0 { [own, others].map(|w| w / (own + others)) } else { [1.0, 0.0] };
        let of_channels = weights([self.recorded.samples, other.recorded.samples].map(f64::from));
        let of_light = weights(samples);
        self.recorded.samples += other.recorded.samples;
        for ((channel, to), from) in self.recorded.channels.iter().zip(&mut self.values).zip(&other.values) {
            let (Values::Float(to), Values::Float(from)) = (to, from) else { continue };
            let [own, others] = if channel.merge == Merge::Light { of_light } else { of_channels };
            match channel.merge {
                _ if others == 0.0 => (),
                Merge::Nearest => (),
                Merge::Mean | Merge::Light => {
                    let mean = |a: f32, b: f32| (f64::from(a) * own + f64::from(b) * others) as f32;
                    to.data.iter_mut().zip(&from.data).for_each(|(a, b)| *a = mean(*a, *b));
                }
                Merge::Ranks => {
                    let pixels = to.data.chunks_exact_mut(to.channels).zip(from.data.chunks_exact(from.channels));
                    pixels.for_each(|(a, b)| {
                        let mut ranks = Ranks::default();
                        ranks.add_pixel(a, own);
                        ranks.add_pixel(b, others);
                        ranks.write(a);
                    });
                }
            }
        }
    }

    /// Takes the channels of one ray from another truth of the same pixels and channels.
    pub(crate) fn copy_nearest(&mut self, other: &Truth) {
        for ((channel, to), from) in self.recorded.channels.iter().zip(&mut self.values).zip(&other.values) {
            if channel.merge == Merge::Nearest {
                to.clone_from(from);
            }
        }
    }
}

/// Coverage of a pixel by identifiers, as [`Merge::Ranks`] stores it: identifier, coverage, identifier, coverage …, most coverage first.
///
/// Identifiers are compared bit by bit. What has as much coverage as another follows it by its bits, so that the order does not depend on that of the samples.
#[derive(Clone, Debug, Default)]
pub struct Ranks {
    found: Vec<(u32, f64)>,
}

impl Ranks {
    /// Forgets what was added.
    pub fn clear(&mut self) {
        self.found.clear();
    }

    /// Adds coverage (0 to 1) of an identifier.
    pub fn add(&mut self, id: f32, coverage: f64) {
        match self.found.iter_mut().find(|(bits, _)| *bits == id.to_bits()) {
            Some((_, sum)) => *sum += coverage,
            None => self.found.push((id.to_bits(), coverage)),
        }
    }

    /// Adds what a pixel holds, weighted.
    fn add_pixel(&mut self, pixel: &[f32], weight: f64) {
        for pair in pixel.as_chunks::<2>().0.iter().filter(|pair| pair[1] > 0.0) {
            self.add(pair[0], f64::from(pair[1]) * weight);
        }
    }

    /// Writes as many ranks as a pixel holds; 0 where there are fewer.
    pub fn write(&mut self, pixel: &mut [f32]) {
        self.found.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        pixel.fill(0.0);
        for (pair, (id, coverage)) in pixel.as_chunks_mut::<2>().0.iter_mut().zip(&self.found) {
            *pair = [f32::from_bits(*id), *coverage as f32];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channels::ChannelId;

    const fn channel(name: &'static str, exr: &'static [&'static str], merge: Merge) -> Channel {
        Channel {
            id: ChannelId::Depth,
            name,
            exr,
            numbers: PixelType::Float,
            unit: "",
            merge,
            missing: 0.0,
            needs_frames: false,
            needs_pupil: false,
            about: "of a test",
        }
    }
    static MEAN: Channel = channel("mean", &["mean"], Merge::Mean);
    static LIGHT: Channel = channel("light", &["light"], Merge::Light);
    static RANKS: Channel = channel("ranks", &["a", "b", "c", "d"], Merge::Ranks);

    fn part(samples: u32, mean: f32, ranks: [f32; 4], depth: f32) -> Truth {
        let mut truth = Truth::missing(Recorded { samples, ..Recorded::new(&[&MEAN, &LIGHT, &RANKS]) }, 1, 1);
        truth.depth_mut().data.fill(depth);
        for (channel, values) in truth.iter_mut() {
            if let Values::Float(raster) = values {
                match channel.name {
                    "mean" | "light" => raster.data.fill(mean),
                    "ranks" => raster.data.copy_from_slice(&ranks),
                    _ => (),
                }
            }
        }
        truth
    }

    #[test]
    fn parts_merge_by_their_samples_and_ranks_by_identifier() {
        let mut a = part(1, 1.0, [7.0, 0.75, 9.0, 0.25], 3.0);
        let b = part(3, 3.0, [9.0, 0.5, 7.0, 0.5], 4.0);
        a.merge(&b, [5.0, 5.0]);
        assert_eq!(a.recorded().samples, 4);
        assert_eq!(a.float("mean").unwrap().data, [2.5]);
        // By the samples of the picture.
        assert_eq!(a.float("light").unwrap().data, [2.0]);
        // 7: (0.75 + 3 · 0.5) / 4, 9: (0.25 + 3 · 0.5) / 4.
        assert_eq!(a.float("ranks").unwrap().data, [7.0, 0.5625, 9.0, 0.4375]);
        assert_eq!(a.depth().data, [3.0]);
        a.copy_nearest(&b);
        assert_eq!((a.depth().data[0], a.float("mean").unwrap().data[0]), (4.0, 2.5));
        // A part without samples of its own changes nothing.
        let before = a.clone();
        a.merge(&part(0, 9.0, [0.0; 4], 1.0), [10.0, 0.0]);
        assert_eq!(a, before);
    }

    #[test]
    fn ranks_do_not_depend_on_the_order_of_samples() {
        let write = |order: [f32; 6]| {
            let (mut ranks, mut pixel) = (Ranks::default(), [9.0; 6]);
            order.iter().for_each(|id| ranks.add(*id, 1.0 / 6.0));
            ranks.write(&mut pixel);
            pixel
        };
        let pixel = write([1.0, 2.0, 3.0, 3.0, 2.0, 4.0]);
        assert_eq!(pixel, write([4.0, 3.0, 2.0, 2.0, 3.0, 1.0]));
        assert_eq!([pixel[0], pixel[2], pixel[4]], [2.0, 3.0, 1.0]);
    }

    #[test]
    fn rows_and_their_sum_are_the_whole() {
        let mut truth = Truth::missing(Recorded::new(&[&MEAN]), 2, 5);
        truth.id_mut().data.iter_mut().enumerate().for_each(|(i, v)| *v = i as u32);
        let mut again = truth.rows(0..2);
        again.append(&truth.rows(2..5)).unwrap();
        assert_eq!(again, truth);
        assert_eq!(truth.recorded().more_bytes(), 4);
        assert_eq!(truth.recorded().bytes(), 4 * 9);
    }
}
