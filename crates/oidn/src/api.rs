//! The functions of `OpenImageDenoise/oidn.h` that are used, and the two objects made of them.

use libloading::Library;
use std::ffi::{CStr, OsStr, c_char, c_int, c_void};
use std::marker::PhantomData;
use std::path::Path;
use std::ptr::{NonNull, null, null_mut};

/// `OIDN_DEVICE_TYPE_CPU`.
const CPU: c_int = 1;
/// `OIDN_FORMAT_FLOAT3`.
const FLOAT3: c_int = 3;

/// `OIDNDevice` and `OIDNFilter`: pointers to what only the library knows.
type Handle = *mut c_void;

/// Why a library cannot be used.
#[non_exhaustive]
pub enum OpenError {
    /// It cannot be opened.
    Library(String),
    /// It lacks a function.
    Function(&'static str),
}

/// Declares the table of functions and how it is read from a library.
macro_rules! functions {
    ($($field:ident: $name:literal = fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions, which hold as long as the library is open.
        pub struct Api {
            $($field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
            // Never closed: threads that it started may outlive its devices, and what they run must stay.
            _library: std::mem::ManuallyDrop<Library>,
        }

        impl Api {
            /// Opens a library: a file, or a name that the system looks up. Fails where it cannot be opened or lacks a function
            /// of version 2.
            pub fn open(path: &Path) -> Result<Self, OpenError> {
                // SAFETY: opening a library runs its initialisers. The paths that come here are the library's own names, or what the user gave
                // as the library.
                let library = unsafe { Library::new::<&OsStr>(path.as_os_str()) }.map_err(|e| OpenError::Library(e.to_string()))?;
                $(
                    // SAFETY: the type is that of the header of version 2 for this name; the pointer is kept beside the library and not longer.
                    let $field = unsafe { *library.get($name.as_bytes()).map_err(|_| OpenError::Function($name))? };
                )*
                Ok(Api { $($field,)* _library: std::mem::ManuallyDrop::new(library) })
            }
        }
    };
}

functions! {
    physical_devices: "oidnGetNumPhysicalDevices" = fn() -> c_int;
    physical_int: "oidnGetPhysicalDeviceInt" = fn(c_int, *const c_char) -> c_int;
    physical_string: "oidnGetPhysicalDeviceString" = fn(c_int, *const c_char) -> *const c_char;
    new_device: "oidnNewDevice" = fn(c_int) -> Handle;
    release_device: "oidnReleaseDevice" = fn(Handle);
    commit_device: "oidnCommitDevice" = fn(Handle);
    device_error: "oidnGetDeviceError" = fn(Handle, *mut *const c_char) -> c_int;
    set_device_int: "oidnSetDeviceInt" = fn(Handle, *const c_char, c_int);
    set_device_bool: "oidnSetDeviceBool" = fn(Handle, *const c_char, bool);
    get_device_int: "oidnGetDeviceInt" = fn(Handle, *const c_char) -> c_int;
    new_filter: "oidnNewFilter" = fn(Handle, *const c_char) -> Handle;
    release_filter: "oidnReleaseFilter" = fn(Handle);
    set_image: "oidnSetSharedFilterImage" = fn(Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);
    set_filter_bool: "oidnSetFilterBool" = fn(Handle, *const c_char, bool);
    set_filter_int: "oidnSetFilterInt" = fn(Handle, *const c_char, c_int);
    commit_filter: "oidnCommitFilter" = fn(Handle);
    execute_filter: "oidnExecuteFilter" = fn(Handle);
}

impl Api {
    /// Name of the CPU as the library has it; `None` where it lists none.
    pub fn cpu_name(&self) -> Option<String> {
        // SAFETY: called without arguments.
        let count = unsafe { (self.physical_devices)() };
        // SAFETY: the numbers are below the count; the name is a terminated string.
        let id = (0..count).find(|id| unsafe { (self.physical_int)(*id, c"type".as_ptr()) } == CPU)?;
        // SAFETY: as above.
        let name = unsafe { (self.physical_string)(id, c"name".as_ptr()) };
        // SAFETY: a string that the library owns, or null.
        (!name.is_null()).then(|| unsafe { CStr::from_ptr(name) }.to_string_lossy().trim().to_owned())
    }

    /// The first error since the last question; of no device, why none could be made.
    fn error(&self, device: Handle) -> Result<(), String> {
        let mut message = null();
        // SAFETY: null or a device that is not released; the message is written if there is an error, and stays the library's.
        let code = unsafe { (self.device_error)(device, &mut message) };
        match code {
            0 => Ok(()),
            _ if message.is_null() => Err(format!("error {code}")),
            // SAFETY: a terminated string that is valid until the next call for this device from this thread.
            _ => Err(unsafe { CStr::from_ptr(message) }.to_string_lossy().into_owned()),
        }
    }
}

/// A device, released when dropped, with the library it belongs to.
pub struct Device {
    handle: NonNull<c_void>,
    api: Api,
}

// SAFETY: functions of the library may be called from any thread ("the API is thread-safe": documentation, "API overview"), and this type gives
// nothing out by which a device could be used after its release.
unsafe impl Send for Device {}
// SAFETY: as above.
unsafe impl Sync for Device {}

impl Device {
    /// The processor, not yet committed. Fails with the library's reason where it makes none.
    pub fn cpu(api: Api) -> Result<Self, String> {
        // SAFETY: a number of the header's enumeration.
        let handle = unsafe { (api.new_device)(CPU) };
        match NonNull::new(handle) {
            Some(handle) => Ok(Device { handle, api }),
            None => Err(api.error(null_mut()).err().unwrap_or_else(|| "the library gives no reason".into())),
        }
    }

    /// Sets a number by its name; the library keeps an error for names it does not know.
    pub fn set_int(&self, name: &CStr, value: c_int) {
        // SAFETY: the device is not released; the name is a terminated string. Unknown names are errors of the library.
        unsafe { (self.api.set_device_int)(self.handle.as_ptr(), name.as_ptr(), value) }
    }

    /// Sets a switch by its name; the library keeps an error for names it does not know.
    pub fn set_bool(&self, name: &CStr, value: bool) {
        // SAFETY: as for `set_int`.
        unsafe { (self.api.set_device_bool)(self.handle.as_ptr(), name.as_ptr(), value) }
    }

    /// A number by its name; 0 of a name that the library does not know.
    pub fn get_int(&self, name: &CStr) -> c_int {
        // SAFETY: as for `set_int`.
        unsafe { (self.api.get_device_int)(self.handle.as_ptr(), name.as_ptr()) }
    }

    /// Makes its settings count. Fails with the first error that the library keeps, that of a name it does not know among them.
    pub fn commit(&self) -> Result<(), String> {
        // SAFETY: the device is not released.
        unsafe { (self.api.commit_device)(self.handle.as_ptr()) };
        self.error()
    }

    fn error(&self) -> Result<(), String> {
        self.api.error(self.handle.as_ptr())
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: released once; filters borrow the device and are gone.
        unsafe { (self.api.release_device)(self.handle.as_ptr()) }
    }
}

/// A filter over images that it borrows, released when dropped.
pub struct Filter<'d, 'i> {
    handle: NonNull<c_void>,
    device: &'d Device,
    images: PhantomData<(&'i [f32], &'i mut [f32])>,
}

impl<'d, 'i> Filter<'d, 'i> {
    /// The filter for ray-traced pictures (`RT`). The device is committed. Fails with the library's reason where it makes none.
    pub fn ray_traced(device: &'d Device) -> Result<Self, String> {
        // SAFETY: a committed device and a terminated string.
        let handle = unsafe { (device.api.new_filter)(device.handle.as_ptr(), c"RT".as_ptr()) };
        match NonNull::new(handle) {
            Some(handle) => Ok(Filter { handle, device, images: PhantomData }),
            None => Err(device.error().err().unwrap_or_else(|| "the library gives no reason".into())),
        }
    }

    /// An image that is read, `[row][column][3]`. Panics unless the numbers are width × height × 3.
    pub fn set_input(&mut self, name: &CStr, data: &'i [f32], size: [usize; 2]) {
        // The library takes one kind of pointer for all images, and reads from those that are inputs.
        self.set_image(name, data.as_ptr().cast_mut(), data.len(), size);
    }

    /// The image that is written, `[row][column][3]`. Panics unless the numbers are width × height × 3.
    pub fn set_output(&mut self, data: &'i mut [f32], size: [usize; 2]) {
        self.set_image(c"output", data.as_mut_ptr(), data.len(), size);
    }

    fn set_image(&mut self, name: &CStr, data: *mut f32, numbers: usize, [width, height]: [usize; 2]) {
        assert_eq!(numbers, width * height * 3, "an image of another size");
        // SAFETY: the numbers are as many as width, height and format say, packed (strides 0), and borrowed for longer than the filter lives; only
        // the output, which is borrowed mutably, is written.
        unsafe { (self.device.api.set_image)(self.handle.as_ptr(), name.as_ptr(), data.cast(), FLOAT3, width, height, 0, 0, 0) }
    }

    /// Sets a switch by its name; the library keeps an error for names it does not know.
    pub fn set_bool(&mut self, name: &CStr, value: bool) {
        // SAFETY: the filter is not released; the name is a terminated string. Unknown names are errors of the library.
        unsafe { (self.device.api.set_filter_bool)(self.handle.as_ptr(), name.as_ptr(), value) }
    }

    /// Sets a number by its name; the library keeps an error for names it does not know.
    pub fn set_int(&mut self, name: &CStr, value: c_int) {
        // SAFETY: as for `set_bool`.
        unsafe { (self.device.api.set_filter_int)(self.handle.as_ptr(), name.as_ptr(), value) }
    }

    /// Makes its images and settings count. Fails with the first error that the library keeps.
    pub fn commit(&mut self) -> Result<(), String> {
        // SAFETY: the filter is not released.
        unsafe { (self.device.api.commit_filter)(self.handle.as_ptr()) };
        self.device.error()
    }

    /// Filters, and returns when it is done. Fails with the library's reason.
    pub fn execute(&mut self) -> Result<(), String> {
        // SAFETY: the filter is committed; its images are valid as said in `set_image`.
        unsafe { (self.device.api.execute_filter)(self.handle.as_ptr()) };
        self.device.error()
    }
}

impl Drop for Filter<'_, '_> {
    fn drop(&mut self) {
        // SAFETY: released once, before the device that it borrows.
        unsafe { (self.device.api.release_filter)(self.handle.as_ptr()) }
    }
}
