//! Requests that draw.

use std::path::Path;
use std::sync::Arc;

use glam::{Mat4, Vec3};

use super::request::{Checked, Class, Parameters, Request};
use super::surface::{self, Corners};
use super::{Reader, emitter};
use crate::render::geometry::{self, Quadric};
use crate::render::{AreaLight, Emitter, Light, Mesh, MeshData};

impl Reader {
    /// Whether the request was a shape, which then is added.
    pub(super) fn geometry(&mut self, request: &Request, path: &Path) -> Checked<bool> {
        let inside_out = self.is_inside_out();
        if let Some((quadric, list)) = surface::quadric(request)? {
            let parameters = request.parameters(list, &self.declared)?;
            self.leave_out_parameters(&parameters, request.line, path);
            if self.shine(&emitter::of_quadric(&quadric, self.placed(), inside_out)) {
                return Ok(true);
            }
            self.warn_of_light(request, path);
            let (quadric, unit) = of_unit_size(quadric);
            let corners = match parameters.texture() {
                Some((st, _)) => Corners::try_from(st).map_err(|st| format!("found {} st, expected 4", st.len()))?,
                None => self.attributes.corners,
            };
            let mesh = self.meshes.get(surface::key(&quadric, &corners, inside_out), || {
                let mut data = quadric.mesh()?;
                surface::map_texture(&mut data, &corners);
                Ok(turned(data, inside_out))
            });
            self.add(mesh.map_err(|e| e.to_string())?, unit, path)?;
            return Ok(true);
        }
        let data = if let Some(list) = surface::list_of_polygons(&request.name) {
            let parameters = request.parameters(list, &self.declared)?;
            self.leave_out_parameters(&parameters, request.line, path);
            let points = parameters.points()?;
            let Some(loops) = surface::loops(request, points.len())? else { return Ok(false) };
            if let [outline] = &loops[..]
                && let [outline] = &outline[..]
                && let Some(corners) =
                    outline.iter().map(|&i| points.get(i as usize).copied()).collect::<Option<Vec<_>>>()
                && self.shine(&emitter::of_polygon(&corners, self.placed(), inside_out))
            {
                return Ok(true);
            }
            surface::polygons(&loops, &parameters)?
        } else if let Some(list) = surface::list_of_patches(&request.name) {
            let parameters = request.parameters(list, &self.declared)?;
            self.leave_out_parameters(&parameters, request.line, path);
            surface::patches(request, &parameters, &self.attributes.bases, &self.attributes.corners)?
        } else if request.name == "SubdivisionMesh" {
            let parameters = request.parameters(surface::subdivision_list(request), &self.declared)?;
            self.leave_out_parameters(&parameters, request.line, path);
            let (data, unknown) = surface::subdivision(request, &parameters)?;
            unknown.into_iter().for_each(|what| self.leave_out(format!("SubdivisionMesh {what}"), request.line, path));
            data
        } else {
            return Ok(false);
        };
        self.warn_of_light(request, path);
        let mesh = Mesh::new(turned(data, inside_out)).map_err(|e| e.to_string())?;
        self.add(mesh.into(), Mat4::IDENTITY, path)?;
        Ok(true)
    }

    /// Says which parameters of a shape are not used.
    fn leave_out_parameters(&mut self, parameters: &Parameters, line: usize, path: &Path) {
        for parameter in &parameters.0 {
            let used = ["P", "Pw", "N", "Np", "st", "s", "t"].contains(&parameter.name.as_str());
            // a projective control point bends a patch
            let bent = parameter.name == "Pw" && parameter.numbers.chunks_exact(4).any(|p| p[3] != 1.0);
            if !used || bent {
                let what = match parameter.class {
                    _ if bent => "Pw with a last coordinate other than 1 (the point is divided by it)".into(),
                    Class::Uniform | Class::Constant => format!("the parameter {:?} of a shape", parameter.name),
                    _ => format!("the parameter {:?} that varies over a shape", parameter.name),
                };
                self.leave_out(what, line, path);
            }
        }
    }

    /// Makes an area light of a shape that can be one, if one is wanted.
    fn shine(&mut self, shape: &Option<Emitter>) -> bool {
        let (Some(radiance), Some(shape), None) = (self.attributes.shining, shape, &self.object) else { return false };
        self.scene.lights.push(Light::Area(AreaLight { shape: *shape, radiance }));
        true
    }

    fn warn_of_light(&mut self, request: &Request, path: &Path) {
        if self.attributes.shining.is_some() {
            let what = format!("AreaLightSource on {} (disks, parallelograms and spheres shine)", request.name);
            self.leave_out(what, request.line, path);
        }
    }

    /// Adds a mesh with the current attributes, or to the object being defined.
    pub(super) fn add(&mut self, mesh: Arc<Mesh>, own: Mat4, path: &Path) -> Checked<()> {
        if let Some(object) = &mut self.object {
            object.parts.push((mesh, object.start.inverse() * self.transform * own));
            return Ok(());
        }
        let (material, texture) = self.material(path)?;
        let transform = self.placed() * own;
        self.scene.place(mesh, transform, material, texture).map_err(|e| e.to_string())
    }
}

fn turned(mut data: MeshData, inside_out: bool) -> MeshData {
    if inside_out {
        geometry::reverse(&mut data);
    }
    data
}

/// A full sphere of radius 1 and how to scale it, so that spheres of all sizes share a mesh.
fn of_unit_size(quadric: Quadric) -> (Quadric, Mat4) {
    match quadric {
        Quadric::Sphere { radius, z_min, z_max, sweep } if radius > 0.0 && z_min <= -radius && z_max >= radius => {
            let unit = Quadric::Sphere { radius: 1.0, z_min: -1.0, z_max: 1.0, sweep };
            (unit, Mat4::from_scale(Vec3::splat(radius)))
        }
        other => (other, Mat4::IDENTITY),
    }
}
