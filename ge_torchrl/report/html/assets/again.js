// The commands that run it again or go on with it, with the folder of this page in it where the page lies on a disk.

const startAgain = () => {
  if (location.protocol !== "file:" || location.host) return;
  // A drive of Windows comes after a slash.
  const path = decodeURIComponent(location.pathname).replace(/^\/(?=[A-Za-z]:)/, "");
  const folder = path.slice(0, path.lastIndexOf("/")) || "/";
  const quoted = /^[\w./:=,+@ -]*$/.test(folder) ? `"${folder}"` : `'${folder.replaceAll("'", "'\\''")}'`;
  for (const word of document.querySelectorAll(".command .word")) {
    if (word.textContent.includes("RUN_FOLDER")) word.textContent = quoted;
  }
  at("again-told").textContent = "Type it where you work; the folder is that of this page.";
};
