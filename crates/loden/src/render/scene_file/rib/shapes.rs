//! Requests that draw shapes.

use std::path::Path;

use glam::{Mat4, Vec3};

use super::materials::Own;
use super::meshes::{self, Corners};
use super::request::{Class, Fault, Parameters, Request, RibResult, Step};
use super::{Reader, blobs, emitter, paint, strands};
use crate::render::geometry::{self, Quadric};
use crate::render::scene_file::MAX_BODIES;
use crate::render::{AreaLight, Emitter, Form, Light, Mesh, MeshData, Revolved, object};

/// Maximum number of shapes that are sampled as lights; more are found by chance alone.
const MAX_AREA_LIGHTS: usize = 256;

/// Colours that vary over a shape, and their storage class.
type Colors = Option<(Vec<Vec3>, Class)>;

impl Reader {
    /// Adds the shape of a request; `false` if the request is not a shape.
    pub(super) fn geometry(&mut self, request: &Request, path: &Path) -> Step<bool> {
        let start = match request.name.as_str() {
            "Geometry" => 1,
            "Points" => 0,
            "Curves" => 3,
            "Blobby" => 4,
            "NuPatch" => 10,
            "SubdivisionMesh" => meshes::subdivision_parameters_start(request),
            name => match (meshes::polygon_parameters_start(name), meshes::patch_parameters_start(name)) {
                (Some(start), _) | (_, Some(start)) => start,
                _ => return self.add_quadric(request, path),
            },
        };
        let Some((parameters, own, colors)) = self.parameters_of_shape(start, request, path)? else { return Ok(true) };
        match request.name.as_str() {
            "Geometry" => self.add_geometry(request, &parameters, own, path)?,
            "Points" | "Curves" => self.add_strands(request, &parameters, own, colors, path)?,
            "Blobby" => {
                let (field, ignored) = blobs::field(request)?;
                if ignored > 0 {
                    self.ignore("repelling planes of Blobby".into(), request.line, path);
                }
                let data = geometry::implicit_mesh(&field).map_err(|e| e.to_string())?;
                self.add_mesh(data, self.with_mean(own, &colors), request, path)?;
            }
            "SubdivisionMesh" => self.add_subdivision(request, &parameters, own, colors, path)?,
            name if meshes::polygon_parameters_start(name).is_some() => {
                self.add_polygons(request, &parameters, own, colors, path)?;
            }
            _ => self.add_patches(request, &parameters, own, colors, path)?,
        }
        Ok(true)
    }

    /// The parameters of a shape, and what they override; `None` if the shape is not drawn.
    fn parameters_of_shape(
        &mut self,
        start: usize,
        request: &Request,
        path: &Path,
    ) -> RibResult<Option<(Parameters, Own, Colors)>> {
        if !self.attributes.visible {
            self.note(
                "shapes are left out that the camera does not see (Attribute \"visibility\")".into(),
                request.line,
                path,
            );
            return Ok(None);
        }
        if !self.attributes.detail.is_drawn() {
            return Ok(None);
        }
        let parameters = request.parameters(start, &self.declared)?;
        self.ignore_parameters(&parameters, request.line, path);
        let mut own = Own::default();
        if let Some((values, _)) = parameters.colors("Os") {
            let mean = values.iter().sum::<Vec3>() / values.len().max(1) as f32;
            if values.iter().any(|value| *value != mean) {
                self.note("the varying opacity \"Os\" of a shape (its mean is used)".into(), request.line, path);
            }
            own.opacity = Some(mean.clamp(Vec3::ZERO, Vec3::ONE));
        }
        if own.opacity.unwrap_or(self.attributes.opacity) == Vec3::ZERO && self.object.is_none() {
            self.note("shapes are left out that are wholly transparent (Opacity 0)".into(), request.line, path);
            return Ok(None);
        }
        let mut colors = parameters.colors("Cs").filter(|(values, _)| !values.is_empty());
        if colors.is_some() && self.is_measured() {
            self.ignore("the shape parameter \"Cs\" on a measured material".into(), request.line, path);
            colors = None;
        }
        if let Some((values, _)) = &colors
            && values.iter().all(|value| *value == values[0])
        {
            own.color = Some(values[0]);
            colors = None;
        }
        Ok(Some((parameters, own, colors)))
    }

    /// With the mean of colours that cannot be drawn as they vary.
    fn with_mean(&self, own: Own, colors: &Colors) -> Own {
        match colors {
            Some((values, _)) => Own { color: Some(values.iter().sum::<Vec3>() / values.len() as f32), ..own },
            None => own,
        }
    }

    fn add_quadric(&mut self, request: &Request, path: &Path) -> Step<bool> {
        let Some((quadric, start)) = meshes::quadric(request)? else { return Ok(false) };
        let Some((parameters, own, colors)) = self.parameters_of_shape(start, request, path)? else { return Ok(true) };
        let inside_out = self.is_inside_out();
        if self.add_area_light(&emitter::of_quadric(&quadric, self.world_from_current(), inside_out)) {
            return Ok(true);
        }
        let corners = match parameters.texture() {
            Some((st, _)) => {
                Corners::try_from(st).map_err(|st| format!("found {} texture coordinates, expected 4", st.len()))?
            }
            None => self.attributes.corners,
        };
        let (own, corners) = self.painted(own, colors, [2, 2], corners);
        self.add_revolved(quadric, &corners, own, request, path)?;
        Ok(true)
    }

    fn add_revolved(
        &mut self,
        quadric: Quadric,
        corners: &Corners,
        own: Own,
        request: &Request,
        path: &Path,
    ) -> Step<()> {
        let form =
            Revolved::new(quadric, corners.map(meshes::down), self.is_inside_out()).map_err(|e| e.to_string())?;
        self.add(form.into(), Mat4::IDENTITY, own, request, path)
    }

    /// A grid of colours as a picture, and the texture coordinates of the corners on it.
    fn painted(&self, own: Own, colors: Colors, grid: [usize; 2], corners: Corners) -> (Own, Corners) {
        let Some((values, _)) = &colors else { return (own, corners) };
        let grid = if values.len() == 4 { [2, 2] } else { grid };
        match paint::grid(grid, values) {
            Some((corners, picture)) => (Own { paint: Some(picture), ..own }, corners),
            None => (self.with_mean(own, &colors), corners),
        }
    }

    fn add_polygons(
        &mut self,
        request: &Request,
        parameters: &Parameters,
        mut own: Own,
        colors: Colors,
        path: &Path,
    ) -> Step<()> {
        let points = parameters.points()?;
        let loops = meshes::loops(request, points.len())?.ok_or("it is no polygon")?;
        if let [outline] = &loops[..]
            && let [outline] = &outline[..]
            && let Some(corners) = outline.iter().map(|&i| points.get(i as usize).copied()).collect::<Option<Vec<_>>>()
            && self.add_area_light(&emitter::of_polygon(&corners, self.world_from_current(), self.is_inside_out()))
        {
            return Ok(());
        }
        let mut data = meshes::polygons(&loops, parameters)?;
        if let Some((values, class)) = &colors {
            let values = meshes::of_corners(values, *class, &loops, "colours")?;
            match paint::mesh(&mut data, &values) {
                Some(picture) => own.paint = Some(picture),
                None => own = self.with_mean(own, &colors),
            }
        }
        self.add_mesh(data, own, request, path)
    }

    fn add_patches(
        &mut self,
        request: &Request,
        parameters: &Parameters,
        own: Own,
        colors: Colors,
        path: &Path,
    ) -> Step<()> {
        let surface = meshes::parametric(request, parameters, &self.attributes.bases)?;
        let corners = meshes::corner_texture(parameters, &self.attributes.corners)?;
        let grid = surface.colors(colors.as_ref().map_or(Class::Varying, |(_, class)| *class));
        let (own, corners) = self.painted(own, colors, grid, corners);
        let data = surface.tessellate(&self.attributes.bases, &corners)?;
        if request.name == "NuPatch" && self.trimmed {
            self.ignore("TrimCurve (the whole surface is drawn)".into(), request.line, path);
        }
        self.add_mesh(data, own, request, path)
    }

    fn add_subdivision(
        &mut self,
        request: &Request,
        parameters: &Parameters,
        mut own: Own,
        colors: Colors,
        path: &Path,
    ) -> Step<()> {
        let scheme = request.text(0)?;
        if scheme != "catmull-clark" {
            self.note(format!("SubdivisionMesh {scheme:?} is subdivided as catmull-clark"), request.line, path);
        }
        let mut control = meshes::control_mesh(request, parameters)?;
        if let Some((values, class)) = &colors {
            let loops: meshes::Loops = control.mesh.faces.iter().map(|face| vec![face.clone()]).collect();
            let values = meshes::of_corners(values, *class, &loops, "colours")?;
            let counts: Vec<usize> = control.mesh.faces.iter().map(Vec::len).collect();
            match paint::faces(&counts, &values) {
                Some((uvs, picture)) => (control.mesh.uvs, own.paint) = (uvs, Some(picture)),
                None => own = self.with_mean(own, &colors),
            }
        }
        for what in &control.unknown {
            self.ignore(format!("the SubdivisionMesh {what}"), request.line, path);
        }
        self.add_mesh(control.subdivide()?, own, request, path)
    }

    fn add_strands(
        &mut self,
        request: &Request,
        parameters: &Parameters,
        mut own: Own,
        colors: Colors,
        path: &Path,
    ) -> Step<()> {
        let viewer = self.viewer().ok_or("the transform is singular")?;
        let strands::Strands { mut data, points } = match request.name.as_str() {
            "Points" => strands::points(parameters, viewer)?,
            _ => strands::curves(request, parameters, &self.attributes.bases[1], viewer)?,
        };
        if let Some((values, class)) = &colors {
            let of = |[point, curve]: &[usize; 2]| match class {
                Class::Uniform if request.name == "Curves" => values.get(*curve),
                _ => values.get(*point),
            };
            let of_vertices: Option<Vec<Vec3>> = points.iter().map(|at| of(at).copied()).collect();
            match of_vertices.and_then(|of_vertices| paint::mesh(&mut data, &of_vertices)) {
                Some(picture) => own.paint = Some(picture),
                None => own = self.with_mean(own, &colors),
            }
        }
        self.add_mesh(data, own, request, path)
    }

    /// Shapes that renderers build in, and those of area lights.
    fn add_geometry(&mut self, request: &Request, _: &Parameters, own: Own, path: &Path) -> Step<()> {
        let corners = meshes::CORNERS;
        let sphere = Quadric::Sphere { radius: 0.5, z_min: -0.5, z_max: 0.5, sweep: 360.0 };
        match request.text(0)? {
            "teapot" => self.add_mesh(object::original_teapot(), own, request, path),
            "cube" | "box" => self.add_mesh(cube(), own, request, path),
            "sphere" | "spherelight" => {
                let emitter = emitter::of_quadric(&sphere, self.world_from_current(), false);
                if self.add_area_light(&emitter) {
                    return Ok(());
                }
                self.add_revolved(sphere, &corners, own, request, path)
            }
            "disklight" | "disk" => {
                let disk = Quadric::Disk { height: 0.0, radius: 0.5, sweep: 360.0 };
                if self.add_area_light(&emitter::of_quadric(&disk, self.world_from_current(), false)) {
                    return Ok(());
                }
                self.add_revolved(disk, &corners, own, request, path)
            }
            "rectlight" | "rectangle" | "plane" => {
                let corners = [[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]].map(|[x, y]| Vec3::new(x, y, 0.0));
                if self.add_area_light(&emitter::of_polygon(&corners, self.world_from_current(), false)) {
                    return Ok(());
                }
                let data = MeshData {
                    positions: corners.to_vec(),
                    normals: vec![Vec3::Z; 4],
                    triangles: vec![[0, 1, 2], [0, 2, 3]],
                    ..MeshData::default()
                };
                self.add_mesh(data, own, request, path)
            }
            "envsphere" => {
                let radiance = self.attributes.emitted.unwrap_or(Vec3::ONE);
                self.add_sky(radiance);
                Ok(())
            }
            other => {
                self.ignore(format!("Geometry {other:?}"), request.line, path);
                Ok(())
            }
        }
    }

    /// Warns of the parameters that are not used.
    fn ignore_parameters(&mut self, parameters: &Parameters, line: usize, path: &Path) {
        const USED: &[&str] = &["P", "Pw", "Pz", "N", "Np", "st", "s", "t", "Cs", "Os", "width", "constantwidth"];
        for parameter in &parameters.0 {
            if !USED.contains(&parameter.name.as_str()) {
                let what = match parameter.class {
                    Class::Uniform | Class::Constant => format!("the shape parameter {:?}", parameter.name),
                    _ => format!("the varying shape parameter {:?}", parameter.name),
                };
                self.ignore(what, line, path);
            }
        }
    }

    /// Adds an area light if the shape can be one and shapes emit light.
    fn add_area_light(&mut self, shape: &Option<Emitter>) -> bool {
        let (Some(radiance), Some(shape), None) = (self.attributes.emitted, shape, &self.object) else {
            return false;
        };
        if self.scene.lights.len() >= MAX_AREA_LIGHTS {
            return false;
        }
        self.scene.lights.push(Light::Area(AreaLight::new(*shape, radiance)));
        true
    }

    fn add_mesh(&mut self, data: MeshData, own: Own, request: &Request, path: &Path) -> Step<()> {
        let mesh = Mesh::new(oriented(data, self.is_inside_out())).map_err(|e| e.to_string())?;
        self.add(mesh.into(), Mat4::IDENTITY, own, request, path)
    }

    /// Adds a shape with the current attributes, or to the object being defined. `transform` moves the shape itself.
    pub(super) fn add(&mut self, form: Form, transform: Mat4, own: Own, request: &Request, path: &Path) -> Step<()> {
        if let Some(object) = &mut self.object {
            let transform = object.start.inverse() * self.transform * transform;
            object.parts.push(form, transform, own);
            return Ok(());
        }
        if self.attributes.emitted.is_some() {
            let what = format!(
                "{} emits light that is found by chance alone (disks, parallelograms and spheres are sampled)",
                request.name
            );
            self.note(what, request.line, path);
        }
        if self.scene.bodies.len() >= MAX_BODIES {
            return Err(Fault::Stop(format!("found more than {MAX_BODIES} shapes")));
        }
        let (material, texture) = self.material(&own)?;
        let transform = self.world_from_current() * transform;
        Ok(self.scene.place(form, transform, material, texture).map_err(|e| e.to_string())?)
    }
}

/// A cube of side 1 around the origin.
fn cube() -> MeshData {
    let mut data = MeshData::default();
    for (axis, sign) in (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]) {
        let unit = |k: usize| Vec3::from_array(std::array::from_fn(|i| if i == k % 3 { 0.5f32 } else { 0.0 }));
        let (n, x, y) = (unit(axis) * sign, unit(axis + 1), unit(axis + 2) * sign);
        let first = data.positions.len() as u32;
        for (a, b) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            data.positions.push(n + x * a + y * b);
            data.normals.push(n * 2.0);
            data.uvs.push(glam::Vec2::new(0.5 + 0.5 * a, 0.5 + 0.5 * b));
        }
        data.triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
    data
}

fn oriented(mut data: MeshData, inside_out: bool) -> MeshData {
    if inside_out {
        geometry::reverse(&mut data);
    }
    data
}
