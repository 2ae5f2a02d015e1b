//! Pages for a browser, plots and texts about a diagnosis, a design and a test stand.

pub mod design;
pub mod diagnosis_page;
pub mod diagnosis_text;
pub mod panels;
pub mod picture;
pub mod steady_state;
pub mod web_page;
