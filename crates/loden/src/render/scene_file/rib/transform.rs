//! Transform requests.

use glam::{Mat4, Vec3};

use super::request::{Request, RibResult};
use super::{Reader, triple};

impl Reader {
    /// Executes a transform request; `false` if the request is not one.
    pub(super) fn transform_request(&mut self, request: &Request) -> RibResult<bool> {
        let change = match request.name.as_str() {
            "Translate" => Mat4::from_translation(triple(request)?),
            "Scale" => Mat4::from_scale(triple(request)?),
            "Rotate" => {
                let (n, _) = request.numbers(4)?;
                let axis = Vec3::from_slice(&n[1..]).try_normalize().ok_or("the axis has length 0")?;
                Mat4::from_axis_angle(axis, n[0].to_radians())
            }
            "Skew" => skew(&request.numbers(7)?.0)?,
            "ConcatTransform" => request.matrix()?,
            "Transform" => {
                self.transform = self.camera_from_world * request.matrix()?;
                return Ok(true);
            }
            "Identity" => {
                self.transform = self.camera_from_world;
                return Ok(true);
            }
            "CoordinateSystem" | "ScopedCoordinateSystem" => {
                self.named_transforms.insert(request.handle(0)?, self.transform);
                return Ok(true);
            }
            "CoordSysTransform" => {
                let name = request.handle(0)?;
                self.transform = match name.as_str() {
                    "world" => self.camera_from_world,
                    "camera" => Mat4::IDENTITY,
                    _ => *self
                        .named_transforms
                        .get(&name)
                        .ok_or_else(|| format!("there is no coordinate system {name:?}"))?,
                };
                return Ok(true);
            }
            _ => return Ok(false),
        };
        self.transform *= change;
        Ok(true)
    }
}

/// A shear by an angle in degrees that turns the first vector towards the second.
fn skew(n: &[f32]) -> RibResult<Mat4> {
    let normalized = |v: Vec3| v.try_normalize().ok_or("an axis has length 0");
    let (from, to) = (normalized(Vec3::from_slice(&n[1..4]))?, normalized(Vec3::from_slice(&n[4..7]))?);
    let across = normalized(from - to * from.dot(to))?;
    // Points at a height along `across` move along `to`: the angle between the axes shrinks by the angle given.
    let between = from.dot(to).clamp(-1.0, 1.0).acos();
    let shift = 1.0 / (between - n[0].to_radians()).tan() - 1.0 / between.tan();
    if !shift.is_finite() {
        return Err("the angle turns one axis onto the other".into());
    }
    let column = |axis: Vec3| (axis + to * (shift * axis.dot(across))).extend(0.0);
    Ok(Mat4::from_cols(column(Vec3::X), column(Vec3::Y), column(Vec3::Z), glam::Vec4::W))
}
