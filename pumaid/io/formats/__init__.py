"""Log formats, a file each: `pumaid.io.log_formats` finds every `LogSource` that a module here defines."""
