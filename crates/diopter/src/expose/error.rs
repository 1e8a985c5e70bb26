//! Why there is no focal plane.

/// Why there is no focal plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ExposeError {
    /// [`ProgressReporter::cancel`](super::ProgressReporter::cancel) was set.
    #[error("the exposure was stopped")]
    Cancelled,
    /// No pixel, no band or no sample.
    #[error("an exposure needs at least one pixel and one sample")]
    Nothing,
    /// The sums to go on from are of another size, of other bands or samples.
    #[error("the checkpoint belongs to another exposure")]
    Foreign,
    /// The temporary file of an exposure larger than memory.
    #[error(
        "the temporary file for the sums of this exposure cannot be written or read ({0}): expected room for 16 bytes a pixel and band"
    )]
    Disk(std::io::ErrorKind),
}

impl From<std::io::Error> for ExposeError {
    fn from(e: std::io::Error) -> Self {
        ExposeError::Disk(e.kind())
    }
}
