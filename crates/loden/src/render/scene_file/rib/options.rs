//! Requests that set the picture and the camera.

use std::path::{Path, PathBuf};

use glam::{Mat4, Vec3};

use super::Reader;
use super::request::{Checked, Request};
use crate::render::{Lens, Projection};

impl Reader {
    /// Whether the request was an option, which then is set.
    pub(super) fn option(&mut self, request: &Request, path: &Path) -> Checked<bool> {
        match request.name.as_str() {
            "Format" => {
                let (n, _) = request.numbers(3)?;
                let side =
                    |v: f32| if (1.0..=65_536.0).contains(&v) { Ok(v as usize) } else { Err(format!("a side is {v}")) };
                (self.scene.settings.width, self.scene.settings.height) = (side(n[0])?, side(n[1])?);
                self.pixel_aspect = if n[2] > 0.0 { n[2] } else { 1.0 };
            }
            "FrameAspectRatio" => {
                let aspect = request.numbers(1)?.0[0];
                if aspect <= 0.0 || !aspect.is_finite() {
                    return Err(format!("found {aspect}, expected more than 0"));
                }
                self.frame_aspect = Some(aspect);
            }
            "ScreenWindow" => {
                self.scene.camera.window = Some(request.numbers(4)?.0.try_into().map_err(|_| "four numbers")?)
            }
            "Projection" => {
                let parameters = request.parameters(1, &self.declared)?;
                self.scene.camera.projection = match request.text(0)? {
                    "perspective" => Projection::Perspective { field_of_view_degrees: parameters.number("fov", 90.0) },
                    "orthographic" => Projection::Orthographic { height: 2.0 },
                    other => return Err(format!("found {other:?}, expected perspective or orthographic")),
                };
                // from here on transforms place the camera
                self.transform = Mat4::IDENTITY;
            }
            "DepthOfField" => {
                if request.arguments.is_empty() {
                    self.scene.camera.lens = Lens::PINHOLE;
                    return Ok(true);
                }
                let (n, _) = request.numbers(3)?;
                let radius = 0.5 * n[1] / n[0];
                self.scene.camera.lens = if radius.is_finite() && radius > 0.0 && n[2].is_finite() {
                    Lens { radius, focus: n[2] }
                } else {
                    Lens::PINHOLE
                };
            }
            "Display" => {
                self.leave_out(request.name.clone(), request.line, path);
                let [name, kind, mode] = [0, 1, 2].map(|place| request.text(place).unwrap_or_default());
                // others are added to the first
                if !name.starts_with('+') {
                    self.depth_only = matches!(kind, "zfile" | "shadow" | "deepshad") || mode == "z";
                }
            }
            "Declare" => self.declared.declare(request.text(0)?, request.text(1)?),
            "Option" => {
                let parameters = request.parameters(1, &self.declared)?;
                for parameter in &parameters.0 {
                    if request.text(0)? == "searchpath" && parameter.name == "archive" {
                        let paths = parameter.texts.iter().flat_map(|text| text.split(':'));
                        self.search
                            .extend(paths.filter(|p| !p.is_empty() && *p != "&" && *p != "@").map(PathBuf::from));
                    } else {
                        let what = format!("Option {:?} {:?}", request.text(0)?, parameter.name);
                        self.leave_out(what, request.line, path);
                    }
                }
            }
            "Imager" => {
                let parameters = request.parameters(1, &self.declared)?;
                if request.text(0)? == "background" {
                    let black = parameters.triple("bgcolor", Vec3::ZERO);
                    self.scene.background = Some(parameters.triple("background", parameters.triple("color", black)));
                } else {
                    self.leave_out(format!("Imager {:?}", request.text(0)?), request.line, path);
                }
            }
            _ => return Ok(false),
        }
        Ok(true)
    }
}
