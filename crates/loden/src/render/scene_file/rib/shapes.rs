//! Requests that draw shapes.

use std::path::Path;

use glam::Mat4;

use super::meshes::{self, Corners};
use super::request::{Class, Parameters, Request, RibResult};
use super::{Reader, emitter};
use crate::render::geometry;
use crate::render::{AreaLight, Emitter, Form, Light, Mesh, MeshData, Revolved};

impl Reader {
    /// Adds the shape of a request; `false` if the request is not a shape.
    pub(super) fn geometry(&mut self, request: &Request, path: &Path) -> RibResult<bool> {
        let inside_out = self.is_inside_out();
        if let Some((quadric, list)) = meshes::quadric(request)? {
            let parameters = request.parameters(list, &self.declared)?;
            self.ignore_parameters(&parameters, request.line, path);
            if self.add_area_light(&emitter::of_quadric(&quadric, self.world_from_current(), inside_out)) {
                return Ok(true);
            }
            self.ignore_area_light(request, path);
            let corners = match parameters.texture() {
                Some((st, _)) => {
                    Corners::try_from(st).map_err(|st| format!("found {} texture coordinates, expected 4", st.len()))?
                }
                None => self.attributes.corners,
            };
            let form = Revolved::new(quadric, corners.map(meshes::down), inside_out).map_err(|e| e.to_string())?;
            self.add(form.into(), Mat4::IDENTITY, path)?;
            return Ok(true);
        }
        let data = if let Some(list) = meshes::polygon_parameters_start(&request.name) {
            let parameters = request.parameters(list, &self.declared)?;
            self.ignore_parameters(&parameters, request.line, path);
            let points = parameters.points()?;
            let Some(loops) = meshes::loops(request, points.len())? else { return Ok(false) };
            if let [outline] = &loops[..]
                && let [outline] = &outline[..]
                && let Some(corners) =
                    outline.iter().map(|&i| points.get(i as usize).copied()).collect::<Option<Vec<_>>>()
                && self.add_area_light(&emitter::of_polygon(&corners, self.world_from_current(), inside_out))
            {
                return Ok(true);
            }
            meshes::polygons(&loops, &parameters)?
        } else if let Some(list) = meshes::patch_parameters_start(&request.name) {
            let parameters = request.parameters(list, &self.declared)?;
            self.ignore_parameters(&parameters, request.line, path);
            meshes::patches(request, &parameters, &self.attributes.bases, &self.attributes.corners)?
        } else if request.name == "SubdivisionMesh" {
            let parameters = request.parameters(meshes::subdivision_parameters_start(request), &self.declared)?;
            self.ignore_parameters(&parameters, request.line, path);
            let (data, unknown) = meshes::subdivision(request, &parameters)?;
            unknown.into_iter().for_each(|what| self.ignore(format!("the SubdivisionMesh {what}"), request.line, path));
            data
        } else {
            return Ok(false);
        };
        self.ignore_area_light(request, path);
        let mesh = Mesh::new(oriented(data, inside_out)).map_err(|e| e.to_string())?;
        self.add(mesh.into(), Mat4::IDENTITY, path)?;
        Ok(true)
    }

    /// Warns of the parameters that are not used.
    fn ignore_parameters(&mut self, parameters: &Parameters, line: usize, path: &Path) {
        for parameter in &parameters.0 {
            let used = ["P", "Pw", "N", "Np", "st", "s", "t"].contains(&parameter.name.as_str());
            // A control point in homogeneous coordinates makes a rational patch.
            let bent = parameter.name == "Pw" && parameter.numbers.chunks_exact(4).any(|p| p[3] != 1.0);
            if !used || bent {
                let what = match parameter.class {
                    _ if bent => "the weights of Pw (points are divided by them)".into(),
                    Class::Uniform | Class::Constant => format!("the shape parameter {:?}", parameter.name),
                    _ => format!("the varying shape parameter {:?}", parameter.name),
                };
                self.ignore(what, line, path);
            }
        }
    }

    /// Adds an area light if the shape can be one and `AreaLightSource` is current.
    fn add_area_light(&mut self, shape: &Option<Emitter>) -> bool {
        let (Some(radiance), Some(shape), None) = (self.attributes.area_light_radiance, shape, &self.object) else {
            return false;
        };
        self.scene.lights.push(Light::Area(AreaLight::new(*shape, radiance)));
        true
    }

    fn ignore_area_light(&mut self, request: &Request, path: &Path) {
        if self.attributes.area_light_radiance.is_some() {
            let what =
                format!("AreaLightSource on {} (only disks, parallelograms and spheres emit light)", request.name);
            self.ignore(what, request.line, path);
        }
    }

    /// Adds a shape with the current attributes, or to the object being defined. `own` transforms the shape itself.
    pub(super) fn add(&mut self, form: Form, own: Mat4, path: &Path) -> RibResult<()> {
        if let Some(object) = &mut self.object {
            object.parts.push((form, object.start.inverse() * self.transform * own));
            return Ok(());
        }
        let (material, texture) = self.material(path)?;
        let transform = self.world_from_current() * own;
        self.scene.place(form, transform, material, texture).map_err(|e| e.to_string())
    }
}

fn oriented(mut data: MeshData, inside_out: bool) -> MeshData {
    if inside_out {
        geometry::reverse(&mut data);
    }
    data
}
