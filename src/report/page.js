'use strict';
// The line between two pictures: dragged on the picture, or moved by the range below it.
for (const figure of document.querySelectorAll('.ab')) {
  const stage = figure.querySelector('.ab-stage');
  const range = figure.querySelector('input');
  const [left, right] = figure.querySelectorAll('select');
  const pictures = [...stage.querySelectorAll('img')];
  const [leftTag, rightTag] = stage.querySelectorAll('.ab-tag');

  function show() {
    stage.style.setProperty('--x', range.value + '%');
    range.setAttribute('aria-valuetext', range.value + ' % ' + left.selectedOptions[0].text);
    pictures.forEach((picture, i) => {
      picture.classList.toggle('a', i === left.selectedIndex);
      picture.classList.toggle('b', i === right.selectedIndex);
    });
    leftTag.textContent = left.selectedOptions[0].text;
    rightTag.textContent = right.selectedOptions[0].text;
  }

  function follow(event) {
    const box = stage.getBoundingClientRect();
    range.value = 100 * (event.clientX - box.left) / box.width;
    show();
  }

  stage.addEventListener('pointerdown', event => {
    stage.setPointerCapture(event.pointerId);
    follow(event);
  });
  stage.addEventListener('pointermove', event => {
    if (stage.hasPointerCapture(event.pointerId)) follow(event);
  });
  for (const control of [range, left, right]) control.addEventListener('input', show);
  show();
}
