//! The server as its clients meet it: what it answers, and what it refuses.

mod answers;
mod attacks;
mod making;
mod running;
mod view;
