for (const button of document.querySelectorAll("button[data-time]")) {
  button.addEventListener("click", () => {
    const video = button.closest("figure").querySelector("video");
    video.currentTime = Number(button.dataset.time);
    video.pause();
  });
}
for (const filter of document.querySelectorAll(".filter")) {
  const box = filter.querySelector("input");
  const table = filter.parentElement.querySelector("table");
  filter.hidden = false;
  box.addEventListener("change", () => table.classList.toggle("failed-only", box.checked));
}
function reveal() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const list = target && target.closest("details");
  if (list && !list.open) {
    list.open = true;
    target.scrollIntoView();
  }
}
addEventListener("hashchange", reveal);
addEventListener("beforeprint", () => {
  for (const error of document.querySelectorAll("details.error")) error.open = true;
});
reveal();
