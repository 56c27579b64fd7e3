//! Rendering of objects that wear materials.
//!
//! World coordinates: x to the right, y up, z towards the default camera. A [`Scene`] holds bodies (a [`Shape`]
//! wearing a material), lights, an environment and a camera; [`render`] traces it. [`studio()`] builds a scene for
//! judging a material: an object of [`object::OBJECTS`], or one from a file, on a seamless floor.

mod bounds;
pub(crate) mod bvh;
mod camera;
mod denoise;
mod environment;
mod filter;
pub mod geometry;
mod guides;
mod hit;
mod instance;
mod integrator;
mod light;
mod mesh;
pub mod object;
mod own_light;
mod path;
mod progressive;
mod ray;
mod revolved;
mod sampler;
mod scene;
pub mod scene_file;
mod settings;
mod shape;
mod studio;
mod surface;
mod texture;
mod traced;
mod tracer;
mod vertex;

pub use bounds::Ball;
pub use camera::{Camera, Lens, Projection};
pub use denoise::{LEAST_SAMPLES, denoise};
pub use environment::{Environment, EnvironmentMap};
pub use guides::Guides;
pub use instance::{Form, Instance};
pub use light::{AreaLight, DirectionalLight, Emitter, Flat, Light, PointLight, SpotLight, from_up};
pub use mesh::{CREASE_DEGREES, Mesh, MeshData};
pub use progressive::{Checkpoint, Effort, Rendered, render, render_in_steps};
pub use revolved::Revolved;
pub use scene::{Body, Scene};
pub use settings::Settings;
pub use shape::{Disc, Shape, Sphere};
pub use studio::{Lighting, Studio, studio, studio_scene};
pub use texture::{MAX_TEXTURE_SAMPLES, Mapping, TextureMap, Wrap};
