//! The test scene of every export: a ball under one distant light, and a camera.

use glam::Vec3;

/// Position of the camera, which looks at the origin; z is up.
pub const EYE: Vec3 = Vec3::new(0.0, -5.0, 2.0);

/// Field of view, degrees.
pub const FIELD_OF_VIEW: f32 = 28.0;

/// From the ball, of radius 1 around the origin, towards the light.
pub const TO_LIGHT: Vec3 = Vec3::new(-0.6, -0.8, 0.9);

/// Irradiance of a surface that faces the light.
pub const IRRADIANCE: f32 = std::f32::consts::PI;

/// Repeats of the material from pole to pole; around the ball it is repeated twice as often.
pub const REPEATS: f32 = 4.0;

/// Side of the picture in pixels.
pub const SIDE: usize = 512;

/// The picture that we render of it.
pub const PICTURE: &str = "ball.png";

/// The same of an original and of what stands for it, side by side.
pub const COMPARISON: &str = "comparison.png";

/// Right, up and forward of the camera.
pub fn axes() -> [Vec3; 3] {
    let forward = (-EYE).normalize();
    let right = forward.cross(Vec3::Z).normalize();
    [right, right.cross(forward), forward]
}

/// A text with the numbers of the scene.
pub(super) fn filled(text: &str) -> String {
    let list = |v: Vec3| format!("[{:?}, {:?}, {:?}]", v.x, v.y, v.z);
    let repeats = REPEATS.to_string();
    text.replace("{EYE}", &list(EYE))
        .replace("{FIELD_OF_VIEW}", &FIELD_OF_VIEW.to_string())
        .replace("{TO_LIGHT}", &list(TO_LIGHT))
        .replace("{FROM_LIGHT}", &list(-TO_LIGHT))
        .replace("{IRRADIANCE}", &format!("{IRRADIANCE:?}"))
        .replace("{REPEATS}", &repeats)
        .replace("{TWICE_REPEATS}", &(2.0 * REPEATS).to_string())
        .replace("{SIDE}", &SIDE.to_string())
}
