//! Instancers: what their prototypes are handed down, and copies of them, each in its own colour.

use super::error;
use super::layer::Key;
use super::stage::{Prim, Stage};
use super::world::{Drawn, MOST_OBJECTS, Place, Read, World};
use glam::{DMat4, DVec3, Vec3};
use std::collections::HashSet;
use std::sync::Arc;

/// Deepest that instancers lie in prototypes of instancers.
const DEEPEST_INSTANCER: usize = 16;

impl World<'_> {
    /// Copies of prototypes. Source: OpenUSD, `UsdGeomPointInstancer`: scale, then orientation, then position.
    pub(super) fn instances(&mut self, prim: &Arc<Prim>, place: &Place) -> Read<()> {
        if place.instancers >= DEEPEST_INSTANCER {
            return Err(error(
                &self.name,
                format!("{}: instancers within instancers", prim.path),
                format!("at most {DEEPEST_INSTANCER} deep"),
            ));
        }
        for name in ["positions", "orientations", "scales"] {
            if self.stage.is_animated(prim, name)? {
                self.skip_unsupported("instances that move by themselves");
            }
        }
        let list = |stage: &Stage, name: &str| -> Read<Arc<[f32]>> {
            Ok(stage.value(prim, name)?.and_then(|v| v.floats()).unwrap_or_else(|| Arc::new([])))
        };
        let ints = |stage: &Stage, name: &str| -> Read<Arc<[i32]>> {
            Ok(stage.value(prim, name)?.and_then(|v| v.ints()).unwrap_or_else(|| Arc::new([])))
        };
        let (which, positions, scales) =
            (ints(&self.stage, "protoIndices")?, list(&self.stage, "positions")?, list(&self.stage, "scales")?);
        let count = which.len().min(positions.len() / 3);
        if count < which.len() {
            self.skip_unsupported("instances without a position");
        }
        let colors = self.instance_colors(prim, which.len())?;
        // Stands for the colour of an instance until that is known.
        let standing_in = colors.as_ref().map(|_| self.push_material(World::display_color(Vec3::ONE, 1.0)));
        let targets = self.stage.targets(prim, "prototypes", Key::TargetPaths)?;
        let mut prototypes: Vec<Vec<Drawn>> = Vec::new();
        for path in targets {
            let before = self.drawn.len();
            let inner = Place {
                node: None,
                local: DMat4::IDENTITY,
                world: DMat4::IDENTITY,
                instancers: place.instancers + 1,
                ..place.clone()
            };
            let inner = self.around_prototype(&path, prim, inner, standing_in)?;
            match self.stage.prim(&path)? {
                Some(prototype) => self.walk(vec![prototype], inner)?,
                None => self.skip_unsupported("prototypes that are not there"),
            }
            prototypes.push(self.drawn.split_off(before));
        }
        let mut turns = list(&self.stage, "orientationsf")?;
        if turns.is_empty() {
            turns = list(&self.stage, "orientations")?;
        }
        let ids = |stage: &Stage, name: &str| -> Read<Arc<[f64]>> {
            Ok(stage.value(prim, name)?.and_then(|v| v.doubles()).unwrap_or_else(|| Arc::new([])))
        };
        let mut hidden: HashSet<i64> = ids(&self.stage, "invisibleIds")?.iter().map(|id| *id as i64).collect();
        hidden.extend(self.stage.listed(prim, Key::InactiveIds)?.iter().filter_map(|id| id.parse::<i64>().ok()));
        let ids = ids(&self.stage, "ids")?;
        for i in 0..count {
            let id = ids.get(i).map_or(i as i64, |id| *id as i64);
            if hidden.contains(&id) {
                continue;
            }
            let Some(prototype) = usize::try_from(which[i]).ok().and_then(|n| prototypes.get(n)) else {
                self.skip_unsupported("instances of prototypes that are not there");
                continue;
            };
            let at = DVec3::from_array(std::array::from_fn(|k| f64::from(positions[3 * i + k])));
            let scale = scales.get(3 * i..3 * i + 3).map_or(DVec3::ONE, |s| Vec3::from_slice(s).as_dvec3());
            let turn =
                turns.get(4 * i..4 * i + 4).map(|q| glam::DQuat::from_xyzw(q[1].into(), q[2].into(), q[3].into(), q[0].into()));
            let turn = turn.filter(|q| q.length_squared() > 1e-12).map_or(glam::DQuat::IDENTITY, |q| q.normalize());
            let instance = DMat4::from_scale_rotation_translation(scale, turn, at);
            if !instance.is_finite() {
                self.skip_unsupported("instances that are nowhere");
                continue;
            }
            if self.drawn.len() + prototype.len() > MOST_OBJECTS {
                return Err(error(&self.name, format!("more than {MOST_OBJECTS} things"), "fewer instances"));
            }
            let (local, world) = (place.local * instance, place.world * instance);
            let recolored = standing_in.zip(colors.as_ref()).map(|(from, all)| {
                let color = Vec3::from_slice(&all[3 * i..3 * i + 3]);
                [from, self.plain(Some(color), place.opacity, false).number]
            });
            self.drawn.extend(prototype.iter().map(|d| Drawn {
                name: d.name.clone(),
                form: d.form,
                node: place.node,
                local: local * d.local,
                world: world * d.local,
                binding: None,
                class: d.class.clone(),
                recolored: d.recolored.or(recolored),
            }));
        }
        Ok(())
    }

    /// A colour for each of so many instances; `None` where there is one for all, or none. Source: OpenUSD, `UsdGeomPointInstancer` (primvars on instances).
    fn instance_colors(&mut self, prim: &Prim, count: usize) -> Read<Option<Vec<f32>>> {
        let name = "primvars:displayColor";
        let Some(colors) = self.stage.value(prim, name)?.and_then(|v| v.floats()).filter(|c| c.len() > 3) else {
            return Ok(None);
        };
        let indices = self.stage.value(prim, &format!("{name}:indices"))?.and_then(|v| v.ints());
        let of = |i: i32| usize::try_from(i).ok().and_then(|i| colors.get(3 * i..3 * i + 3));
        let all: Option<Vec<&[f32]>> = match indices.filter(|i| !i.is_empty()) {
            Some(indices) => indices.iter().map(|i| of(*i)).collect(),
            None => Some(colors.chunks_exact(3).collect()),
        };
        let all = all.filter(|all| all.len() == count).map(|all| all.concat());
        if all.is_none() {
            self.skip_unsupported("colours that do not fit their instances");
        }
        Ok(all)
    }

    /// What a prototype is handed down: what the prims around it say, not those around its instancer. Colours of the instances come before those from further out.
    fn around_prototype(&mut self, path: &str, instancer: &Prim, place: Place, standing_in: Option<u32>) -> Read<Place> {
        let outer_color = standing_in.or(place.instance_color);
        let mut inner = Place { bindings: None, color: None, opacity: None, instance_color: None, ..place };
        for (end, _) in path.match_indices('/').skip(1) {
            let Some(prim) = self.stage.prim(&path[..end])? else { break };
            self.hand_down(&prim, &mut inner)?;
            if prim.path == instancer.path && standing_in.is_some() {
                (inner.color, inner.instance_color) = (None, standing_in);
            }
        }
        if inner.color.is_none() {
            inner.instance_color = outer_color;
        }
        Ok(inner)
    }
}
