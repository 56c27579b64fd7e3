//! Option requests: image size, projection, lens, output.

use std::path::Path;

use glam::{Mat4, Vec3};

use super::Reader;
use super::condition::Value;
use super::materials::folder_of;
use super::request::{Request, RibResult};
use super::worlds::Kind;
use crate::memory::Memory;
use crate::render::{Lens, Projection};

/// Least memory for the images of a BTF. Scenes may have been written for the textures of another time.
const LEAST_TEXTURE_MEMORY: u64 = 16 << 20;

impl Reader {
    /// Executes an option request; `false` if the request is not an option.
    pub(super) fn option(&mut self, request: &Request, path: &Path) -> RibResult<bool> {
        match request.name.as_str() {
            "Format" => self.format(request)?,
            "FrameAspectRatio" => self.frame_aspect = Some(frame_aspect(request)?),
            "ScreenWindow" => {
                self.scene.camera.window = Some(request.numbers(4)?.0.try_into().map_err(|_| "expected 4 numbers")?)
            }
            "Projection" => self.projection(request, path)?,
            "DepthOfField" => self.scene.camera.lens = lens(request)?,
            "Display" => self.display(request, path),
            "Declare" => self.declared.declare(request.text(0)?, request.text(1)?),
            "Option" => self.named_option(request, path)?,
            "Imager" => self.imager(request, path)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    fn format(&mut self, request: &Request) -> RibResult<()> {
        let (n, _) = request.numbers(3)?;
        let side = |v: f32| {
            if (1.0..=65_536.0).contains(&v) {
                Ok(v as usize)
            } else {
                Err(format!("found a resolution of {v}, expected 1 to 65536"))
            }
        };
        (self.scene.settings.width, self.scene.settings.height) = (side(n[0])?, side(n[1])?);
        self.pixel_aspect = if n[2] > 0.0 { n[2] } else { 1.0 };
        Ok(())
    }

    fn projection(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        let parameters = request.parameters(1, &self.declared)?;
        let fov = parameters.number("fov", 90.0);
        let perspective = || {
            if (0.1..=170.0).contains(&fov) {
                Ok(Projection::Perspective { field_of_view_degrees: fov })
            } else {
                Err(format!("found a field of view of {fov} degrees, expected 0.1 to 170"))
            }
        };
        self.scene.camera.projection = match request.text(0)? {
            "orthographic" | "PxrOrthographic" => Projection::Orthographic { height: 2.0 },
            "perspective" | "PxrPerspective" | "PxrCamera" => perspective()?,
            other => {
                self.note(format!("Projection {other:?} is unknown: perspective is used"), request.line, path);
                perspective()?
            }
        };
        // The transforms that follow place the camera.
        self.transform = Mat4::IDENTITY;
        Ok(())
    }

    /// Ignores the output file, but notes what the next world is for.
    fn display(&mut self, request: &Request, path: &Path) {
        self.ignore(request.name.clone(), request.line, path);
        let [name, kind, mode] = [0, 1, 2].map(|index| request.text(index).unwrap_or_default());
        // A name with "+" is an additional output; the first one decides.
        if !name.starts_with('+') {
            self.kind = Kind::of_display(kind, mode);
        }
    }

    fn named_option(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        let parameters = request.parameters(1, &self.declared)?;
        let kind = request.text(0)?;
        for parameter in &parameters.0 {
            let name = format!("{kind}:{}", parameter.name);
            let paths = match name.as_str() {
                "searchpath:archive" => Some(&mut self.archives_path),
                "searchpath:texture" => Some(&mut self.textures_path),
                _ => None,
            };
            if let (Some(paths), false) = (paths, parameter.texts.is_empty()) {
                paths.set(&parameter.texts.join(":"), folder_of(path));
                continue;
            }
            if let ("limits:texturememory", Some(kilobytes)) = (name.as_str(), parameter.numbers.first()) {
                self.limit_textures(*kilobytes);
                continue;
            }
            if kind != "user" {
                self.ignore(format!("Option {kind:?} {:?}", parameter.name), request.line, path);
            }
            let number = parameter.numbers.first().map(|&number| Value::Number(number.into()));
            if let Some(value) = number.or(parameter.texts.first().cloned().map(Value::Text)) {
                self.variables.insert(name, value);
            }
        }
        Ok(())
    }

    /// Limits the images of each BTF, unless the caller did.
    fn limit_textures(&mut self, kilobytes: f32) {
        if self.may_limit && kilobytes >= 0.0 {
            self.scene.memory = Some(Memory(((f64::from(kilobytes) * 1024.0) as u64).max(LEAST_TEXTURE_MEMORY)));
        }
    }

    fn imager(&mut self, request: &Request, path: &Path) -> RibResult<()> {
        let parameters = request.parameters(1, &self.declared)?;
        if request.text(0)? == "background" {
            let black = parameters.triple("bgcolor", Vec3::ZERO);
            self.scene.background = Some(parameters.triple("background", parameters.triple("color", black)));
        } else {
            self.ignore(format!("Imager {:?}", request.text(0)?), request.line, path);
        }
        Ok(())
    }
}

fn frame_aspect(request: &Request) -> RibResult<f32> {
    let aspect = request.numbers(1)?.0[0];
    if aspect <= 0.0 || !aspect.is_finite() {
        return Err(format!("found {aspect}, expected a positive number"));
    }
    Ok(aspect)
}

/// The lens of `DepthOfField fstop focallength focaldistance`; without arguments a pinhole.
fn lens(request: &Request) -> RibResult<Lens> {
    if request.arguments.is_empty() {
        return Ok(Lens::PINHOLE);
    }
    let (n, _) = request.numbers(3)?;
    let radius = 0.5 * n[1] / n[0];
    let is_open = radius.is_finite() && radius > 0.0 && n[2].is_finite();
    Ok(if is_open { Lens { radius, focus: n[2] } } else { Lens::PINHOLE })
}
