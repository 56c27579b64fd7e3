//! Scenes as text in the RenderMan Interface Bytestream.
//!
//! # Model
//! World space stays right-handed; the transform before `WorldBegin` goes to RenderMan's left-handed camera. Quadrics stay what they
//! are, meshes become polygons with their normals and texture coordinates, every shape with its own transform. Lights of irradiance pi
//! have intensity 1.
//!
//! # Limits
//! What the interface, or our reader of it, has no request for is refused by name: pictures of environments and area lights, suns with an
//! extent, textures that do not repeat, and mappings by sphere, cylinder and three planes, which start from an axis of world space.
//! Environments are lights of a newer interface, which older renderers leave out. Tangents of glTF files are computed again.
//!
//! # References
//! pixar2000

use std::f32::consts::PI;
use std::fmt::Write as _;

use glam::{Mat4, Vec2, Vec3};

use super::{SceneBody, SceneFile};
use crate::render::geometry::Quadric;
use crate::render::{
    AreaLight, Camera, Emitter, Environment, Form, Light, Mapping, Mesh, Projection, Revolved, Shape, TextureMap, Wrap,
};
use crate::{Error, Result};

/// Numbers with spaces in between.
fn list(numbers: impl IntoIterator<Item = f32>) -> String {
    numbers.into_iter().map(|number| number.to_string()).collect::<Vec<_>>().join(" ")
}

fn triple(v: Vec3) -> String {
    format!("[{}]", list(v.to_array()))
}

/// A matrix for row vectors, as the interface has it.
fn matrix(m: Mat4) -> String {
    format!("[{}]", list(m.to_cols_array()))
}

fn refuse(what: &str, problem: &str) -> Error {
    Error::parameter(what, format!("{problem} cannot be written as RIB"))
}

impl SceneFile {
    /// The scene in RIB. `surfaces` has the request for each material, without texture mapping: `Surface "loden" "string material" ["wool.loden"]`,
    /// with a `Color` before it if need be.
    ///
    /// # Errors
    /// [`Error::Parameter`] naming what RIB cannot say.
    pub fn to_rib(&self, surfaces: &[String]) -> Result<String> {
        let settings = self.settings;
        let mut text = format!(
            "##RenderMan RIB-Structure 1.0\nversion 3.03\nOption \"searchpath\" \"string shader\" [\".:&\"]\nOption \"searchpath\" \"string texture\" [\".:&\"]\nFormat {} {} 1\n",
            settings.width, settings.height
        );
        text += &camera(&self.camera, [settings.width, settings.height]);
        let seen = match (&self.background, &self.environment) {
            (Some(color), _) | (None, Environment::Constant(color)) => *color,
            (None, Environment::Dark) => Vec3::ZERO,
            (None, Environment::Map(_)) => return Err(refuse("environment", "a picture of the environment")),
        };
        let _ = writeln!(text, "Imager \"background\" \"color background\" {}\nWorldBegin", triple(seen));
        match &self.environment {
            Environment::Dark => {}
            Environment::Constant(radiance) => {
                let _ = writeln!(text, "  Light \"PxrDomeLight\" \"sky\" \"color lightColor\" {}", triple(*radiance));
            }
            Environment::Map(_) => return Err(refuse("environment", "a picture of the environment")),
        }
        for (number, light) in self.lights.iter().enumerate() {
            text += &self::light(light, number + 1)?;
        }
        for body in &self.bodies {
            text += &self::body(body, &surfaces[body.material])?;
        }
        Ok(text + "WorldEnd\n")
    }
}

fn camera(camera: &Camera, sides: [usize; 2]) -> String {
    let forward = (camera.target - camera.position).normalize();
    let right = forward.cross(camera.up).normalize();
    let rows = Mat4::from_cols(right.extend(0.0), right.cross(forward).extend(0.0), forward.extend(0.0), glam::Vec4::W);
    let camera_from_world = rows.transpose() * Mat4::from_translation(-camera.position);
    let mut text = match camera.projection {
        Projection::Perspective { field_of_view_degrees: fov } => {
            format!("Projection \"perspective\" \"fov\" [{fov}]\n")
        }
        Projection::Orthographic { .. } => "Projection \"orthographic\"\n".into(),
    };
    // the window of a parallel projection has the size of what is seen
    let shorter = sides[0].min(sides[1]) as f32;
    let [x, y] = sides.map(|side| side as f32 / shorter);
    let (scale, window) = match (camera.projection, camera.window) {
        (Projection::Orthographic { height }, window) => (0.5 * height, Some(window.unwrap_or([-x, x, -y, y]))),
        (Projection::Perspective { .. }, window) => (1.0, window),
    };
    if let Some(window) = window {
        let _ = writeln!(text, "ScreenWindow {}", list(window.map(|edge| edge * scale)));
    }
    if camera.lens.radius > 0.0 {
        let _ = writeln!(text, "DepthOfField 1 {} {}", 2.0 * camera.lens.radius, camera.lens.focus);
    }
    text + &format!("ConcatTransform {}\n", matrix(camera_from_world))
}

fn light(light: &Light, number: usize) -> Result<String> {
    let (light, shadows) = if let Light::Shadowless(light) = light { (&**light, "off") } else { (light, "on") };
    let color = |irradiance: Vec3| format!("\"float intensity\" [1] \"color lightcolor\" {}", triple(irradiance / PI));
    let source = |name: &str, rest: String| {
        format!("  Attribute \"light\" \"string shadows\" [\"{shadows}\"]\n  LightSource \"{name}\" {number} {rest}\n")
    };
    Ok(match light {
        Light::Directional(light) if light.radius_degrees > 0.0 => {
            return Err(refuse("light", "a distant light with an extent"));
        }
        Light::Directional(light) => source(
            "distantlight",
            format!("{} \"point from\" {} \"point to\" [0 0 0]", color(light.irradiance), triple(light.direction)),
        ),
        Light::Point(light) => {
            source("pointlight", format!("{} \"point from\" {}", color(light.intensity), triple(light.position)))
        }
        Light::Spot(light) => source(
            "spotlight",
            format!(
                "{} \"point from\" {} \"point to\" {} \"float coneangle\" [{}] \"float conedeltaangle\" [{}] \"float beamdistribution\" [{}]",
                color(light.intensity),
                triple(light.position),
                triple(light.position + light.axis),
                light.angle_degrees.to_radians(),
                light.edge_degrees.to_radians(),
                light.falloff
            ),
        ),
        Light::Area(light) => area(light, number)?,
        Light::Shadowless(_) => return Err(refuse("light", "a light without shadows inside another")),
    })
}

fn area(light: &AreaLight, number: usize) -> Result<String> {
    if light.is_textured() {
        return Err(refuse("light", "the picture of an area light"));
    }
    let shape = match light.shape {
        Emitter::Rectangle(flat) => {
            let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)];
            let corner = |(a, b): (f32, f32)| list((flat.centre + a * flat.x + b * flat.y).to_array());
            format!("Polygon \"P\" [{}]", corners.map(corner).join("  "))
        }
        Emitter::Disk(flat) => {
            let normal = flat.x.cross(flat.y).normalize();
            let to =
                Mat4::from_cols(flat.x.extend(0.0), flat.y.extend(0.0), normal.extend(0.0), flat.centre.extend(1.0));
            format!("ConcatTransform {}\n    Disk 0 1 360", matrix(to))
        }
        Emitter::Sphere { centre, radius } => {
            format!("Translate {}\n    Sphere {radius} {} {radius} 360", list(centre.to_array()), -radius)
        }
    };
    Ok(format!(
        "  AttributeBegin\n    AreaLightSource \"arealight\" {number} \"float intensity\" [1] \"color lightcolor\" {}\n    {shape}\n  AttributeEnd\n",
        triple(light.radiance)
    ))
}

fn body(body: &SceneBody, surface: &str) -> Result<String> {
    let (transform, shape) = match &body.shape {
        Shape::Mesh(mesh) => (Mat4::IDENTITY, polygons(mesh)),
        Shape::Instance(instance) => {
            let shape = match instance.form() {
                Form::Mesh(mesh) => polygons(mesh),
                Form::Revolved(revolved) => quadric(revolved),
            };
            (instance.world_from_object(), shape)
        }
        Shape::Sphere(_) | Shape::Disc(_) => return Err(refuse("shape", "a ball or disc of the studio")),
    };
    let texture = mapping(&body.texture)?;
    let mut text = format!("  AttributeBegin\n    {}{texture}\n", surface.replace('\n', "\n    "));
    if transform != Mat4::IDENTITY {
        let _ = writeln!(text, "    ConcatTransform {}", matrix(transform));
    }
    Ok(text + &shape + "  AttributeEnd\n")
}

/// The parameters of a surface that map its texture.
fn mapping(texture: &TextureMap) -> Result<String> {
    let mut text = String::new();
    if texture.scale != 1.0 {
        let _ = write!(text, " \"float scale\" [{}]", texture.scale);
    }
    if texture.rotation_degrees != 0.0 {
        let _ = write!(text, " \"float rotation\" [{}]", texture.rotation_degrees);
    }
    if texture.samples != 1 {
        let _ = write!(text, " \"float samples\" [{}]", texture.samples);
    }
    if texture.wrap != Wrap::Repeat {
        return Err(refuse("wrap", "a texture that does not repeat"));
    }
    match texture.mapping {
        Mapping::Surface => {}
        Mapping::Plane { origin, u, v } => {
            let [origin, u, v] = [origin, u, v].map(triple);
            let _ = write!(
                text,
                " \"string mapping\" [\"plane\"] \"point origin\" {origin} \"vector edgeu\" {u} \"vector edgev\" {v}"
            );
        }
        Mapping::Camera { position, target, up, field_of_view_degrees } => {
            let [from, to, up] = [position, target, up].map(triple);
            let _ = write!(
                text,
                " \"string mapping\" [\"camera\"] \"point from\" {from} \"point to\" {to} \"vector up\" {up} \"float fov\" [{field_of_view_degrees}]"
            );
        }
        Mapping::Sphere { .. } | Mapping::Cylinder { .. } | Mapping::Triplanar { .. } => {
            return Err(refuse("mapping", "a spherical, cylindrical or triplanar mapping"));
        }
    }
    Ok(text)
}

/// t points down.
fn down(uv: Vec2) -> [f32; 2] {
    [uv.x, 1.0 - uv.y]
}

fn polygons(mesh: &Mesh) -> String {
    let data = mesh.data();
    let indices: Vec<String> = data.triangles.iter().flatten().map(u32::to_string).collect();
    let vectors = |all: &[Vec3]| list(all.iter().flat_map(|v| v.to_array()));
    format!(
        "    PointsPolygons [{}] [{}]\n      \"P\" [{}]\n      \"N\" [{}]\n      \"st\" [{}]\n",
        vec!["3"; data.triangles.len()].join(" "),
        indices.join(" "),
        vectors(&data.positions),
        vectors(&data.normals),
        list(data.uvs.iter().copied().flat_map(down))
    )
}

fn quadric(revolved: &Revolved) -> String {
    let corners = list(revolved.corners().into_iter().flat_map(down));
    let mut text = format!("    TextureCoordinates {corners}\n");
    if revolved.is_inside_out() {
        text += "    ReverseOrientation\n";
    }
    let (name, numbers) = match *revolved.quadric() {
        Quadric::Sphere { radius, z_min, z_max, sweep } => ("Sphere", vec![radius, z_min, z_max, sweep]),
        Quadric::Cone { height, radius, sweep } => ("Cone", vec![height, radius, sweep]),
        Quadric::Cylinder { radius, z_min, z_max, sweep } => ("Cylinder", vec![radius, z_min, z_max, sweep]),
        Quadric::Hyperboloid { from, to, sweep } => {
            ("Hyperboloid", vec![from.x, from.y, from.z, to.x, to.y, to.z, sweep])
        }
        Quadric::Paraboloid { r_max, z_min, z_max, sweep } => ("Paraboloid", vec![r_max, z_min, z_max, sweep]),
        Quadric::Disk { height, radius, sweep } => ("Disk", vec![height, radius, sweep]),
        Quadric::Torus { major_radius, minor_radius, phi_min, phi_max, sweep } => {
            ("Torus", vec![major_radius, minor_radius, phi_min, phi_max, sweep])
        }
    };
    text + &format!("    {name} {}\n", list(numbers))
}
