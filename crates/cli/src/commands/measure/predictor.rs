//! What the chain of lens, sensor and development makes of edges, for pictures whose camera is known.

use crate::UsageError;
use anyhow::anyhow;
use diopter::lens::CompoundLens;
use diopter::measure::developed::{Developed, Development};
use diopter::measure::motion::Motion;
use diopter::measure::mtf::Options;
use diopter::measure::predict::{Chain, Prediction};
use diopter::measure::{Channel, EdgeMtf};
use diopter::sensor::Sensor;

/// The camera whose pictures are predicted.
pub(super) struct Predictor<'a> {
    pub(super) lens: CompoundLens,
    pub(super) sensor: Sensor,
    pub(super) film_mm: [f64; 2],
    /// Pixels of the mosaic.
    pub(super) size: [usize; 2],
    pub(super) diffraction: bool,
    pub(super) motion: Motion<'a>,
    pub(super) light: &'a str,
}

impl Predictor<'_> {
    fn chain(&self, channel: usize) -> Chain<'_> {
        Chain {
            lens: &self.lens,
            sensor: &self.sensor,
            channel,
            light: self.light,
            film_mm: self.film_mm,
            size: self.size,
            diffraction: self.diffraction,
            motion: self.motion,
        }
    }

    /// The chain at edges of a raw channel.
    pub(super) fn raw(&self, channel: Channel, edges: &[EdgeMtf]) -> anyhow::Result<Predicted> {
        let names = self.sensor.cfa.channel_names();
        let letters: &[&str] = match channel {
            Channel::Red => &["R"],
            Channel::Green => &["G"],
            Channel::Blue => &["B"],
            Channel::Clear => &["W", "Y"],
            Channel::Luminance => &[],
        };
        let number = names.iter().position(|n| letters.contains(n)).ok_or_else(|| {
            UsageError(anyhow!(
                "channel {}: expected one of {} on {}; of a developed picture the raw file that it was made of (--raw)",
                channel.name(),
                names.join(", "),
                self.sensor.name
            ))
        })?;
        let chain = self.chain(number);
        let chains = edges.iter().map(|e| Ok(chain.predict(e)?)).collect::<anyhow::Result<Vec<_>>>()?;
        Ok(Predicted { chains, developed: vec![], pitch_mm: self.film_mm[0] / self.size[0] as f64 })
    }

    /// The chain and the development at edges of a developed picture of a size.
    pub(super) fn developed(
        &self,
        development: &Development,
        channel: Channel,
        edges: &[EdgeMtf],
        options: &Options,
    ) -> anyhow::Result<Predicted> {
        let chain = self.chain(0);
        let all =
            edges.iter().map(|e| Ok(development.predict(&chain, e, channel, options)?)).collect::<anyhow::Result<Vec<_>>>()?;
        Ok(Predicted { chains: vec![], developed: all, pitch_mm: self.film_mm[0] / development.size[0] as f64 })
    }
}

/// What was predicted for edges.
pub(super) struct Predicted {
    /// Of raw channels.
    pub(super) chains: Vec<Prediction>,
    /// Of developed pictures; else empty.
    pub(super) developed: Vec<Developed>,
    /// Distance of the pixels that are measured, mm.
    pub(super) pitch_mm: f64,
}

impl Predicted {
    /// What measured responses are held against.
    pub(super) fn lines(&self) -> Vec<&[f64]> {
        match self.developed.is_empty() {
            true => self.chains.iter().map(|p| &p.windowed[..]).collect(),
            false => self.developed.iter().map(|p| &p.product[..]).collect(),
        }
    }
}
