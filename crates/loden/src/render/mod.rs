//! Pictures of objects wearing a material.
