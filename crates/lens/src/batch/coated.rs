//! What is on surfaces, as packets need it.

use crate::coating::{LightTable, SurfaceCoating};
use crate::system::System;
use std::sync::Arc;

/// What is on a surface, as packets need it.
#[derive(Clone, Debug)]
pub(super) enum Coated {
    Bare,
    Perfect,
    /// Lets this fraction through.
    Flat(f64),
    QuarterWave,
    Table(Arc<LightTable>),
}

/// What is on each surface; surfaces with the same films between the same media share a table.
pub(super) fn coatings(system: &System) -> Vec<Coated> {
    let mut tables: Vec<Arc<LightTable>> = vec![];
    let coated = |(i, s): (usize, &crate::system::PlacedSurface)| match &s.coating {
        SurfaceCoating::Bare => Coated::Bare,
        SurfaceCoating::Perfect => Coated::Perfect,
        SurfaceCoating::Flat(reflectance) => Coated::Flat(1.0 - reflectance),
        SurfaceCoating::QuarterWave => Coated::QuarterWave,
        SurfaceCoating::Layers(stack) => {
            let media = [&system.glasses[i], &system.glasses[i + 1]];
            let known = tables.iter().find(|t| t.serves(stack, media, s.mirror)).cloned();
            Coated::Table(known.unwrap_or_else(|| {
                let table = Arc::new(LightTable::new(stack, media, s.mirror));
                tables.push(table.clone());
                table
            }))
        }
    };
    system.surfaces.iter().enumerate().map(coated).collect()
}
